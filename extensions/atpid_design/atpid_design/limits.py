# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a design should not be trusted as it stands: lines with the value, the limit and what to do."""

import math
from collections.abc import Iterator, Sequence

from atpid_design.check import Check
from atpid_design.motor import FAST, YIELD_BEGINS, Motor
from atpid_design.problem import STANDARD_GRAVITY, Problem, scene_of
from atpid_design.worst_case import Point
from atpid_sim.contact.materials import mismatch
from atpid_sim.scene.plausibility import FRICTION_LIMIT, SLOPE_LIMIT, friction_number

#: Overlap over the grain's radius up to which Hertz's theory of small contacts holds [-].
_SHALLOW = 0.1
#: Change of the efficiency over the box of uncertainties above which a design is called sensitive [-].
_SENSITIVE = 0.15
#: Ceiling higher than this [m] is a tall container for a test stand.
_TALL = 1.0
#: Acceleration [g] that few structures and no machine's foundation bear. Velocity [m/s] of a steel beam in bending at
#: which its stress is some 200 MPa, 70 MPa for each m/s (Hunt, J. Acoust. Soc. Am. 32, 1960, 1123).
_HARSH, _FAST, _STRESS = 20.0, 3.0, 70.0
#: Mass of the grain over that of the structure, above which it is another structure rather than a damped one [-].
_HEAVY = 0.5


def warnings_of(problem: Problem, fraction: float, points: Sequence[Point], drive: Motor, found: Check) -> list[str]:
    """Return one line for each limit that the design meets."""
    last = points[-1]
    # the design's own scene has sensors and windows that fit; what its contact is said not to be is said by option
    unusual = scene_of(problem, fraction, last.amplitude, last.height).warnings()
    other = f"contact.young_modulus: {mismatch(problem.density, problem.young_modulus)}"
    scene = [line for line in unusual if line != other and not line.startswith(("sensors", "steady_window"))]
    return [
        *_aim(problem, points),
        *_worse(problem, points),
        *_impossible(problem, fraction, points),
        *_materials(problem),
        *_gravity(problem, points),
        *_sideways(problem, points),
        *_contact(problem, points, drive),
        *_sensitivity(problem, points, found),
        *_motor(drive),
        *_container(problem, points),
        *scene,
    ]


def _at(problem: Problem, *points: Point) -> str:
    scale, unit = problem.unit
    return ", ".join(f"±{scale * one.amplitude:.3g}" for one in points) + f" {unit}"


def _aim(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    for name in ("efficiency", "reduction"):
        target = getattr(problem, f"target_{name}")
        least = min(getattr(one, name).low for one in points)
        if target is not None and least < target:
            yield (
                f"--target-{name}: {100 * target:.0f} % is not kept by any grain up to a mass fraction of "
                f"{problem.max_mass_fraction:g}; this one keeps {100 * least:.0f} %: allow a heavier grain, or state "
                "smaller uncertainties"
            )


def _worse(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    """Name each amplitude at which the structure moves more than without the damper."""
    sure: dict[float, list[Point]] = {}
    for one in points:
        for tone in one.over_frequency:
            if tone.reduction < 0.0:
                sure.setdefault(tone.frequency, []).append(one)
    possible = [one for one in points if one.reduction.low < 0.0]
    beside = (
        f"without the damper the structure's resonance is at {problem.frequency:.4g} Hz, and the excitation beside it: "
        "state the machine's frequency (--excitation-frequency)"
        if problem.excitation_frequency is None
        else "if the machine stays there, leave the structure as it is, or allow another grain (--max-mass-fraction)"
    )
    for frequency, found in sure.items():
        yield f"reduction below 0: the damper makes it worse at {frequency:.4g} Hz and {_at(problem, *found)}; {beside}"
    if possible and not sure:
        least = 100.0 * min(one.reduction.low for one in possible)
        yield (
            f"reduction below 0 in some of the cases at {_at(problem, *possible)}, down to {least:.0f} %: within the "
            f"uncertainties the damper may make it worse; {beside}"
        )


def _impossible(problem: Problem, fraction: float, points: Sequence[Point]) -> Iterator[str]:
    """Name motions that no structure survives, and a grain too heavy for it."""
    last = points[-1]
    omega = 2.0 * math.pi * last.frequency
    moves = max(last.closed_amplitude, last.bare_amplitude.expected)
    acceleration, velocity = omega**2 * moves / STANDARD_GRAVITY, omega * moves
    if acceleration > _HARSH or velocity > _FAST:
        units = "metres and those of the support" if problem.drive == "support" else "newtons"
        yield (
            f"structure: a {problem.drive} of {_at(problem, last)} would move it by ±{1e3 * moves:.3g} mm undamped, "
            f"{acceleration:.0f} g and {velocity:.2g} m/s (limits {_HARSH:g} g, {_FAST:g} m/s; a steel "
            f"beam in bending bears some {_STRESS:g} MPa for each m/s): are --amplitudes in {units}, "
            "and is --damping right?"
        )
    weight = fraction / (1.0 - fraction)
    if weight > _HEAVY:
        yield (
            f"grain: it weighs {100 * weight:.0f} % of the structure, more than {100 * _HEAVY:.0f} %: can the "
            "structure bear it? --max-mass-fraction limits it"
        )


def _materials(problem: Problem) -> Iterator[str]:
    other = mismatch(problem.density, problem.young_modulus)
    if other:
        yield (
            f"--young-modulus: {other}, and e = {problem.restitution:g} is not known to be theirs (steel on steel: 0.6 "
            "to 0.9): measure the grain on its walls, give --young-modulus, --restitution and --density"
        )


def _gravity(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    heavy = [one for one in points if one.acceleration < 1.0]
    if heavy:
        omega = 2.0 * math.pi * heavy[0].frequency
        least = problem.gravity / (omega**2 * heavy[0].closed_amplitude / heavy[0].amplitude)
        yield (
            f"gravity: up to {_at(problem, heavy[-1])} the beam's acceleration stays below gravity and the grain rests "
            f"on the floor; the open damper does nothing below {problem.level(least)}"
        )
    idle = [one for one in points if one.rate == 0.0 and one.acceleration >= 1.0]
    if idle:
        yield (
            f"gravity: up to {_at(problem, idle[-1])} the grain does not reach the ceiling at the best height "
            f"(acceleration of the closed damper {idle[-1].acceleration:.0f} g): the floor alone reduces the motion"
        )


def _sideways(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    """Name friction on a side wall and rotation of the container, which are left out, where they matter."""
    ratios = [
        friction_number(problem.side_friction, problem.gravity, (2.0 * math.pi * p.frequency) ** 2 * p.closed_amplitude)
        for p in points
    ]
    if (most := max(ratios)) > FRICTION_LIMIT:
        beyond = [one for one, ratio in zip(points, ratios, strict=True) if ratio > FRICTION_LIMIT]
        yield (
            f"side wall: at {_at(problem, *beyond)} friction decelerates the grain by up to {most:.2g} of the closed "
            f"damper's acceleration (limit {FRICTION_LIMIT:g}); sliding and rolling are left out and change the "
            "amplitude: smoother walls (--side-friction), larger amplitudes, or find the height on the stand "
            "(docs/horizontal.md)"
        )
    angle = problem.slope * max(one.closed_amplitude for one in points)
    if angle > SLOPE_LIMIT:
        yield (
            f"slope: the closed damper would turn the container by {angle:.2g} rad (limit {SLOPE_LIMIT:g}); impacts on "
            "side walls are left out: a longer beam or two in parallel (--slope), or smaller amplitudes "
            "(docs/horizontal.md)"
        )


def _contact(problem: Problem, points: Sequence[Point], drive: Motor) -> Iterator[str]:
    deepest = max(one.overlap for one in points)
    if deepest > _SHALLOW:
        # the depth of an impact goes with the modulus to the power -2/5
        enough = problem.young_modulus * (deepest / _SHALLOW) ** 2.5
        yield (
            f"contact: the grain is pressed {deepest:.2f} of its radius into a wall; beyond {_SHALLOW:g} the law is an "
            f"extrapolation: take a Young's modulus of at least {enough:.2g} Pa, or smaller amplitudes"
        )
    if problem.yield_strength is not None and drive.yield_strength > problem.yield_strength:
        yield (
            f"contact: peak pressure {1e-6 * drive.pressure:.4g} MPa; below the surface yield begins at "
            f"{YIELD_BEGINS:g} times the yield strength, {1e-6 * YIELD_BEGINS * problem.yield_strength:.4g} MPa: walls "
            f"and grain are dented, {drive.impacts_a_day:.2g} times a day; take a larger grain, or "
            "a softer and tougher material"
        )


def _sensitivity(problem: Problem, points: Sequence[Point], found: Check) -> Iterator[str]:
    wide = [one for one in points if (seen := getattr(one, problem.aim)).high - seen.low > _SENSITIVE]
    if wide:
        what = "uncertainties" if problem.excitation_frequency is None else "uncertainties and frequencies"
        yield f"sensitive: the {problem.aim} changes by more than 15 points over the {what} at {_at(problem, *wide)}"
    rough = [one for one in points if not one.regular]
    if rough:
        yield (
            f"irregular motion in some of the cases at {_at(problem, *rough)}: the intervals are widened by 15 % of "
            "the amplitude"
        )
    if found.outside:
        yield (
            f"check: {found.outside} of {found.structures} structures between the amplitudes lay outside, by up to "
            f"{100 * found.excess:.1f} points; the interval is widened to include them"
        )


def _motor(drive: Motor) -> Iterator[str]:
    if drive.speed_ratio > FAST:
        yield (
            f"motor: {1e3 * drive.speed:.3g} mm/s is {drive.speed_ratio:.2f} of the impacts' closing speed; a ceiling "
            "that moves so fast changes the impacts: change the excitation more slowly"
        )
    if drive.gear < 1.0:
        yield (
            f"motor: {1e3 * drive.speed:.3g} mm/s needs a gear that makes it faster at {drive.motor_speed:g} 1/min and "
            f"a lead of {1e3 * drive.lead:g} mm: a faster motor (--motor-speed), or a slower excitation"
        )


def _container(problem: Problem, points: Sequence[Point]) -> Iterator[str]:
    highest = max(one.height for one in points)
    if highest > _TALL:
        yield (
            f"container: the ceiling reaches {1e3 * highest:.0f} mm; a heavier grain needs less, in inverse "
            "proportion to its mass (--max-mass-fraction), or limit it by --max-height"
        )
    stopped = [one for one in points if one.best_height > 0.999 * problem.max_height]
    if stopped:
        yield f"container: from {_at(problem, stopped[0])} on the height is limited by --max-height"
