# SPDX-License-Identifier: Apache-2.0
"""Where a design should not be trusted as it stands: lines with the value, the limit and what to do."""

import math
from collections.abc import Iterator, Sequence

from atpid_control.design.check import Check
from atpid_control.design.motor import FAST, Motor
from atpid_control.design.problem import Problem, resonance, scene_of
from atpid_control.design.promise import Point

#: Overlap over the grain's radius up to which Hertz's theory of small contacts holds [-].
_SHALLOW = 0.1
#: Change of the efficiency over the box of uncertainties above which a design is called sensitive [-].
_SENSITIVE = 0.15
#: Ceiling higher than this [m] is a tall container for a test stand.
_TALL = 1.0


def warnings_of(
    problem: Problem, fraction: float, points: Sequence[Point], drive: Motor, found: Check
) -> list[str]:  # fmt: skip
    """Return one line for each limit that the design meets."""
    last = points[-1]
    # the design's own scene has sensors and windows that fit
    unusual = scene_of(problem, fraction, last.amplitude, last.height).warnings()
    scene = [line for line in unusual if not line.startswith(("sensors", "steady_window"))]
    return [
        *_aim(problem, points),
        *_gravity(problem, fraction, points),
        *_contact(problem, points),
        *_sensitivity(points, found),
        *_motor(drive),
        *_container(problem, points),
        *scene,
    ]


def _aim(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    least = min(one.efficiency.low for one in points)
    if problem.target_reduction is not None and least < problem.target_reduction:
        yield (
            f"--target-reduction: {100 * problem.target_reduction:.0f} % is not kept by any grain up to a mass "
            f"fraction of {problem.max_mass_fraction:g}; this one keeps {100 * least:.0f} %: allow a heavier grain, "
            "or state smaller uncertainties"
        )


def _gravity(problem: Problem, fraction: float, points: Sequence[Point]) -> Iterator[str]:
    omega = 2.0 * math.pi * resonance(problem, fraction)
    heavy = [one for one in points if one.acceleration < 1.0]
    if heavy:
        least = problem.gravity / (omega**2 * heavy[0].closed_amplitude / heavy[0].amplitude)
        yield (
            f"gravity: up to {heavy[-1].amplitude:.3g} m the beam's acceleration stays below gravity and the grain "
            f"rests on the floor; there is no reduction below {least:.3g} m"
        )
    idle = [one for one in points if one.rate == 0.0 and one.acceleration >= 1.0]
    if idle:
        yield (
            f"gravity: up to {idle[-1].amplitude:.3g} m the grain does not reach the ceiling at the best height "
            f"(acceleration of the closed damper {idle[-1].acceleration:.0f} g): the floor alone reduces the motion"
        )


def _contact(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    deepest = max(one.overlap for one in points)
    if deepest > _SHALLOW:
        # the depth of an impact goes with the modulus to the power -2/5
        enough = problem.young_modulus * (deepest / _SHALLOW) ** 2.5
        yield (
            f"contact: the grain is pressed {deepest:.2f} of its radius into a wall; beyond {_SHALLOW:g} the law is an "
            f"extrapolation: take a Young's modulus of at least {enough:.2g} Pa, or smaller amplitudes"
        )


def _sensitivity(points: Sequence[Point], found: Check) -> Iterator[str]:
    wide = [one for one in points if one.efficiency.high - one.efficiency.low > _SENSITIVE]
    if wide:
        spans = ", ".join(f"{one.amplitude:.3g} m" for one in wide)
        yield f"sensitive: the efficiency changes by more than 15 points over the uncertainties at {spans}"
    rough = [one for one in points if not one.regular]
    if rough:
        spans = ", ".join(f"{one.amplitude:.3g} m" for one in rough)
        yield f"irregular motion in some of the cases at {spans}: the interval is widened by 15 % of the amplitude"
    if found.outside:
        yield (
            f"check: {found.outside} of {found.structures} structures between the amplitudes lay outside, by up to "
            f"{100 * found.excess:.1f} points; the interval is widened to include them"
        )


def _motor(drive: Motor) -> Iterator[str]:
    if drive.speed_ratio > FAST:
        yield (
            f"motor: {drive.speed:.3g} m/s is {drive.speed_ratio:.2f} of the impacts' closing speed; a ceiling that "
            "moves so fast changes the impacts: change the excitation more slowly"
        )


def _container(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    highest = max(one.height for one in points)
    if highest > _TALL:
        yield (
            f"container: the ceiling reaches {highest:.2f} m; a heavier grain needs less, in inverse proportion to its "
            "mass (--max-mass-fraction), or limit it by --max-height"
        )
    stopped = [one for one in points if one.best_height > 0.999 * problem.max_height]
    if stopped:
        yield f"container: from {stopped[0].amplitude:.3g} m on the height is limited by --max-height"
