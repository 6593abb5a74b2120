# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The designed damper beside a tuned mass as heavy as its grain, on the same structure under the same excitation.

The tuned mass is the best for the band of the excitation over the natural frequency, with what both may be off by. It
is ideal: linear at any stroke, spring and damper without mass. Neither damper is designed anew when a frequency
changes: spring and damper stay, and the ceiling keeps the designed height of the support's amplitude.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_design.check import height_at
from atpid_design.problem import NOMINAL, Case, Deviation, Problem, case, grain_mass, modes_of
from atpid_design.tuned_mass import ANY_FREQUENCY, TunedBeam, Tuning, optimised, over
from atpid_design.worst_case import Point, response_of
from atpid_sim.modal import ModeSet
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.quantities import efficiency

#: By how much a frequency changes [-]; changes of the excitation's that are drawn.
CHANGE, _DRAWN = 0.1, 31


class MassRow(NamedTuple):
    """The structure's amplitude in one state, without a damper and with each; NaN: a run failed."""

    state: str
    amplitude: float  # of the support [m] or the force [N]
    frequency: float  # of the excitation [Hz]
    bare: float  # without a damper [m]
    closed: float  # with the damper closed [m]
    damper: float  # with the damper at its designed height [m]
    tuned: float  # with the tuned mass [m]

    @property
    def reductions(self) -> tuple[float, float]:
        """Reductions by damper and tuned mass [-]."""
        return efficiency(self.damper, self.bare), efficiency(self.tuned, self.bare)


@dataclass(frozen=True)
class Comparison:
    """The tuned mass, and what it does beside the damper."""

    mass: float  # [kg]
    frequency: float  # natural frequency of the tuned mass [Hz]
    damping: float  # of its damper [N s/m]
    damping_ratio: float  # the same over its own critical damping [-]
    band: tuple[float, float]  # of the excitation's frequency that it is the best for [Hz]
    stroke: float  # its largest amplitude against the structure at the largest of the support, design frequency [m]
    rows: list[MassRow]
    over_frequency: list[MassRow]  # at the middle amplitude


def compare(problem: Problem, fraction: float, points: Sequence[Point]) -> Comparison:
    """Return the comparison for the design heights of points at rising amplitudes."""
    mass = grain_mass(problem, fraction)
    ratio, band = mass / problem.mass, _band(problem)
    tuning = optimised(ratio, problem.damping, band, _over_beam(problem, fraction, NOMINAL))
    middle, last = points[len(points) // 2], points[-1]
    changes = [
        *((f"{problem.drive} {problem.level(one.amplitude)}", one, NOMINAL) for one in (points[0], middle, last))
    ]
    every, by = len(problem.further_modes), (-CHANGE, -0.5 * CHANGE, 0.5 * CHANGE, CHANGE)
    changes += [(f"excitation {100 * c:+.0f} %", middle, Deviation(detuning=c)) for c in by]
    changes += [
        (f"natural frequency {100 * c:+.0f} %", middle, Deviation(frequency=c, further=((0.0, c, 0.0),) * every))
        for c in by
    ]
    # as far as the resonance of the structure without a damper, if that is higher
    most = max(CHANGE, 1.03 * problem.frequency / middle.frequency - 1.0)
    drawn = [("", middle, Deviation(detuning=float(d))) for d in np.linspace(-CHANGE, most, _DRAWN)]
    jobs = [*changes, *drawn]
    rows = dict(on_all_cores(lambda k: _row(problem, fraction, tuning, points, *jobs[k]), list(range(len(jobs)))))
    own = 2.0 * math.pi * problem.frequency
    return Comparison(
        mass=mass,
        frequency=tuning.frequency * problem.frequency,
        damping=2.0 * mass * own * tuning.damping,
        damping_ratio=tuning.damping / tuning.frequency,
        band=(band[0] * problem.frequency, band[1] * problem.frequency),
        stroke=last.amplitude * float(
            _tuned(problem, fraction, tuning, NOMINAL).stroke(last.frequency / problem.frequency)
        ),
        rows=[rows[k] for k in range(len(changes))],
        over_frequency=[rows[k] for k in range(len(changes), len(jobs))],
    )  # fmt: skip


def _band(problem: Problem) -> tuple[float, float]:
    """Return the excitation's frequency over the structure's, from and to, with what both may be off by."""
    if problem.excitation_frequency is None:
        return ANY_FREQUENCY
    low, high = problem.excitation_frequency
    off = problem.uncertainty.frequency + problem.uncertainty.detuning
    return low * (1.0 - off) / problem.frequency, high * (1.0 + off) / problem.frequency


def _row(
    problem: Problem, fraction: float, tuning: Tuning, points: Sequence[Point], state: str, at: Point, off: Deviation
) -> MassRow:
    frequency = None if problem.excitation_frequency is None else at.frequency
    one = case(problem, fraction, off, frequency=frequency)
    return MassRow(
        state, at.amplitude, one.damper.frequency, one.bare(at.amplitude), one.damper.closed_amplitude(at.amplitude),
        _damped(one, at.amplitude, height_at(points, at.amplitude)),
        at.amplitude * float(_tuned(problem, fraction, tuning, off).beam(
            one.damper.frequency / (problem.frequency * (1.0 + off.frequency))
        )),
    )  # fmt: skip


def _tuned(problem: Problem, fraction: float, tuning: Tuning, off: Deviation) -> TunedBeam:
    """Return the structure off by a deviation with the tuned mass, whose spring and damper stay."""
    scale = 1.0 / (1.0 + off.frequency)
    return TunedBeam(
        grain_mass(problem, fraction) / problem.mass, problem.damping,
        Tuning(scale * tuning.frequency, scale * tuning.damping), _over_beam(problem, fraction, off),
    )  # fmt: skip


def _over_beam(problem: Problem, fraction: float, off: Deviation) -> ModeSet | None:
    modes = modes_of(problem, fraction, off)
    return None if modes is None else over(modes.free, problem.mass, problem.frequency * (1.0 + off.frequency))


def _damped(one: Case, amplitude: float, height: float) -> float:
    try:
        return response_of(one, amplitude, height).amplitude
    except NumericalFailure:
        return math.nan
