# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A tuned mass damper on a damped beam with a moving support, or on one of several modes, in closed form.

It is the passive device that the damper is compared to.

Everything is over the beam alone: frequencies over its natural frequency, damping over its critical damping, absolute
displacements over that of the support, or over a force. With an undamped beam on its support the absolute displacement
is that of Den Hartog's mass under a force (Mechanical Vibrations, 4th edition, section 3.3), since the support drives
it through the spring alone.

`compare` sets the designed damper beside one as heavy as its grain, on the same structure under the same excitation: it
is the best for the band of the excitation over the natural frequency, with what both may be off by, and ideal: linear
at any stroke, spring and damper without mass. Neither damper is designed anew when a frequency changes: spring and
damper stay, and the ceiling keeps the designed height of the support's amplitude.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from atpid_design.check import height_at
from atpid_design.problem import NOMINAL, Deviation, Problem, case, grain_mass, modes_of
from atpid_design.worst_case import Point, response_of
from atpid_sim.modal import ModeSet
from atpid_sim.outcome import NumericalFailure
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.system import Array

#: Frequency ratios among which a peak is looked for where no band is given; how far apart, and how many at least.
_ANY_FREQUENCY, _APART, _FEWEST = (0.3, 2.0), 1e-3, 101
#: In place of no resistance, at the resonance of a mode without damping: the quotient of two infinities is then right.
_NONE = 1e-30
#: Least damping of a tuned mass, as defined below: a spring and its guide have that of themselves [-].
_LEAST_DAMPING = 0.002


@dataclass(frozen=True)
class Tuning:
    """Spring and damper of a tuned mass."""

    frequency: float  # natural frequency of the tuned mass on a fixed beam, over the beam's [-]
    damping: float  # c_a / (2 m_a omega_beam), as Den Hartog has it [-]


@dataclass(frozen=True)
class TunedBeam:
    """A beam that carries a tuned mass."""

    mass_ratio: float  # mu, tuned over beam mass [-]
    damping_ratio: float  # of the beam alone [-]
    tuning: Tuning
    modes: ModeSet | None = None  # of several, or under a force: over mass and frequency of the beam (`over`)

    @property
    def structure(self) -> ModeSet:
        """The structure without the tuned mass."""
        one, own = np.ones(1), np.full(1, 2.0 * self.damping_ratio)
        return self.modes or ModeSet(one, one, own, one, own, np.zeros(1))

    def beam(self, ratio: float | Array) -> Array:
        """Return the beam's amplitude over the support's, shape of `ratio` [-], the excitation's frequency ratio."""
        return np.abs(self._beam(np.asarray(ratio, dtype=float)))

    def stroke(self, ratio: float | Array) -> Array:
        """Return the amplitude of the tuned mass against the beam over the support's, shape of `ratio` [-]."""
        r = np.asarray(ratio, dtype=float)
        return np.asarray(np.abs(self._beam(r) * r * r / (self._spring(r) - r * r)))

    def peak(self, band: tuple[float, float] = _ANY_FREQUENCY) -> float:
        """Return the largest amplitude of the beam over the support's in a band of frequency ratios [-]."""
        ratios = np.linspace(*band, max(1 + round((band[1] - band[0]) / _APART), _FEWEST))
        values = self.beam(ratios)
        tops = 1 + np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:]))
        refine = partial(minimize_scalar, lambda r: -float(self.beam(r)), method="bounded", options={"xatol": 1e-10})
        refined = (refine(bounds=(ratios[k - 1], ratios[k + 1])).fun for k in tops)
        return float(max([*(-value for value in refined), values[0], values[-1]]))

    def _spring(self, r: Array) -> Array:
        """Return the complex stiffness of the tuned mass's spring and damper, over m_a omega_beam^2."""
        return np.asarray(self.tuning.frequency**2 + 2j * self.tuning.damping * r)

    def _beam(self, r: Array) -> Array:
        spring = self._spring(r)
        carried = self.mass_ratio * r * r * spring / (spring - r * r)
        s, x = self.structure, r[..., None]
        resistance = s.stiffness - s.mass * x * x + 1j * x * s.damping
        resistance = np.where(np.abs(resistance) < _NONE, _NONE, resistance)
        alone = ((s.direct + 1j * x * s.rate) / resistance).sum(axis=-1)
        return np.asarray(alone / (1.0 - carried * (1.0 / resistance).sum(axis=-1)))


def over(modes: ModeSet, mass: float, frequency: float) -> ModeSet:
    """Return modes over a mass [kg] and the stiffness that it has at a frequency [Hz]; a force stays in newtons."""
    omega = 2.0 * math.pi * frequency
    per = np.array([mass, mass * omega**2, mass * omega, mass * omega**2, mass * omega, 1.0])
    return ModeSet(*(np.array(modes) / per[:, None]))


def den_hartog(mass_ratio: float) -> Tuning:
    """Return Den Hartog's tuning, which ignores the beam's damping: equal fixed points, Brock's damping.

    f = 1 / (1 + mu), zeta^2 = 3 mu / (8 (1 + mu)^3); the peak on an undamped beam is close to sqrt(1 + 2 / mu).
    """
    return Tuning(1.0 / (1.0 + mass_ratio), math.sqrt(3.0 * mass_ratio / (8.0 * (1.0 + mass_ratio) ** 3)))


def optimised(
    mass_ratio: float, damping_ratio: float, band: tuple[float, float] = _ANY_FREQUENCY, modes: ModeSet | None = None
) -> Tuning:
    """Return the tuning whose largest amplitude in a band of frequency ratios is least, the beam's damping included."""
    starts = [den_hartog(mass_ratio)]
    if band != _ANY_FREQUENCY:
        starts.append(Tuning(0.5 * (band[0] + band[1]), 0.02))

    def tuning(x: Array) -> Tuning:
        return Tuning(float(x[0]), max(abs(float(x[1])), _LEAST_DAMPING))

    def peak(x: Array) -> float:
        return TunedBeam(mass_ratio, damping_ratio, tuning(x), modes).peak(band)

    found = []
    for start in starts:
        f, z = start.frequency, start.damping
        options = {"xatol": 1e-9, "fatol": 1e-11, "initial_simplex": np.array([[f, z], [1.01 * f, z], [f, 1.1 * z]])}
        found.append(minimize(peak, [f, z], method="Nelder-Mead", options=options))
    return tuning(min(found, key=lambda one: float(one.fun)).x)


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
    chosen = points[0], middle, last
    changes = [(f"{problem.drive} {problem.level(one.amplitude)}", one, NOMINAL) for one in chosen]
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
    own, tuned = 2.0 * math.pi * problem.frequency, _tuned(problem, fraction, tuning, NOMINAL)
    return Comparison(
        mass=mass,
        frequency=tuning.frequency * problem.frequency,
        damping=2.0 * mass * own * tuning.damping,
        damping_ratio=tuning.damping / tuning.frequency,
        band=(band[0] * problem.frequency, band[1] * problem.frequency),
        stroke=last.amplitude * float(tuned.stroke(last.frequency / problem.frequency)),
        rows=[rows[k] for k in range(len(changes))],
        over_frequency=[rows[k] for k in range(len(changes), len(jobs))],
    )


def _band(problem: Problem) -> tuple[float, float]:
    """Return the excitation's frequency over the structure's, from and to, with what both may be off by."""
    if problem.excitation_frequency is None:
        return _ANY_FREQUENCY
    low, high = problem.excitation_frequency
    off = problem.uncertainty.frequency + problem.uncertainty.detuning
    return low * (1.0 - off) / problem.frequency, high * (1.0 + off) / problem.frequency


def _row(
    problem: Problem, fraction: float, tuning: Tuning, points: Sequence[Point], state: str, at: Point, off: Deviation
) -> MassRow:
    frequency = None if problem.excitation_frequency is None else at.frequency
    one, amplitude = case(problem, fraction, off, frequency=frequency), at.amplitude
    ratio = one.damper.frequency / (problem.frequency * (1.0 + off.frequency))
    tuned = amplitude * float(_tuned(problem, fraction, tuning, off).beam(ratio))
    closed, damped = one.damper.closed_amplitude(amplitude), math.nan
    with suppress(NumericalFailure):
        damped = response_of(one, amplitude, height_at(points, amplitude)).amplitude
    return MassRow(state, amplitude, one.damper.frequency, one.bare(amplitude), closed, damped, tuned)


def _tuned(problem: Problem, fraction: float, tuning: Tuning, off: Deviation) -> TunedBeam:
    """Return the structure off by a deviation with the tuned mass, whose spring and damper stay."""
    scale, ratio = 1.0 / (1.0 + off.frequency), grain_mass(problem, fraction) / problem.mass
    moved = Tuning(scale * tuning.frequency, scale * tuning.damping)
    return TunedBeam(ratio, problem.damping, moved, _over_beam(problem, fraction, off))


def _over_beam(problem: Problem, fraction: float, off: Deviation) -> ModeSet | None:
    modes = modes_of(problem, fraction, off)
    return None if modes is None else over(modes.free, problem.mass, problem.frequency * (1.0 + off.frequency))
