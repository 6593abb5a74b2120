# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A tuned mass damper on a damped beam with a moving support, or on one of several modes, in closed form.

It is the passive device that the damper is compared to.

Everything is over the beam alone: frequencies over its natural frequency, damping over its critical damping, absolute
displacements over that of the support, or over a force. With an undamped beam on its support the absolute displacement
is that of Den Hartog's mass under a force (Mechanical Vibrations, 4th edition, section 3.3), since the support drives
it through the spring alone.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from atpid_design.problem import Problem, Uncertainty, deviation, drawn_frequencies, modes_of, resonance
from atpid_sim.modal import ModeSet, bare_amplitude, phasors
from atpid_sim.robust import inside
from atpid_sim.system import Array

#: Frequency ratios among which a peak is looked for where no band is given; how far apart, and how many at least.
ANY_FREQUENCY, _APART, _FEWEST = (0.3, 2.0), 1e-3, 101
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

    def peak(self, band: tuple[float, float] = ANY_FREQUENCY) -> float:
        """Return the largest amplitude of the beam over the support's in a band of frequency ratios [-]."""
        ratios = np.linspace(*band, max(1 + round((band[1] - band[0]) / _APART), _FEWEST))
        values = self.beam(ratios)
        tops = 1 + np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:]))
        refined = (
            minimize_scalar(
                lambda r: -float(self.beam(r)), bounds=(ratios[k - 1], ratios[k + 1]), method="bounded",
                options={"xatol": 1e-10},
            ).fun
            for k in tops
        )  # fmt: skip
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
    mass_ratio: float, damping_ratio: float, band: tuple[float, float] = ANY_FREQUENCY, modes: ModeSet | None = None
) -> Tuning:
    """Return the tuning whose largest amplitude in a band of frequency ratios is least, the beam's damping included."""
    starts = [den_hartog(mass_ratio)]
    if band != ANY_FREQUENCY:
        starts.append(Tuning(0.5 * (band[0] + band[1]), 0.02))

    def tuning(x: Array) -> Tuning:
        return Tuning(float(x[0]), max(abs(float(x[1])), _LEAST_DAMPING))

    def peak(x: Array) -> float:
        return TunedBeam(mass_ratio, damping_ratio, tuning(x), modes).peak(band)

    found = [
        minimize(
            peak, [start.frequency, start.damping], method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-11, "initial_simplex": _around(start)},
        )
        for start in starts
    ]  # fmt: skip
    return tuning(min(found, key=lambda one: float(one.fun)).x)


def _around(start: Tuning) -> Array:
    f, z = start.frequency, start.damping
    return np.array([[f, z], [1.01 * f, z], [f, 1.1 * z]])


#: Structures drawn for the amplitude of several modes without the damper, and their seed.
_DRAWN, _SEED = 512, 5


def bare_range(problem: Problem, fraction: float, amplitude: float) -> tuple[float, float]:
    """Return the least and largest amplitude [m] without the damper within the box, for an identified amplitude [m].

    Of one mass on its support it depends on frequency ratio and damping ratio only; all between the ends is looked at.
    Of several modes, and under a force, it is that of drawn structures, most of them at corners of the box.
    """
    u = problem.uncertainty
    if problem.is_modal:
        low, high = _bare_over_drive(problem, fraction)
        return amplitude * low, amplitude * high
    resonant = resonance(problem, fraction)
    low, high = problem.excitation_frequency or (resonant, resonant)
    # the grain's mass is known, so an error of the beam's moves the resonance
    moved = 0.5 * fraction * u.mass if problem.excitation_frequency is None else u.frequency
    ratios = np.linspace(low * (1.0 - u.detuning) / (1.0 + moved), high * (1.0 + u.detuning) / (1.0 - moved), 501)
    ratios = np.append(ratios / problem.frequency, np.clip(1.0, *ratios[[0, -1]] / problem.frequency))
    found = [
        bare_amplitude(1.0, 1.0, 2.0 * problem.damping * (1.0 + side * u.damping), amplitude, ratio / (2.0 * math.pi))
        for ratio in ratios
        for side in (-1.0, 1.0)
    ]
    return min(found) * (1.0 - u.amplitude), max(found) * (1.0 + u.amplitude)


@functools.lru_cache(maxsize=64)
def _bare_over_drive(problem: Problem, fraction: float) -> tuple[float, float]:
    """Return the least and largest amplitude without the damper over that of the drive, of several modes [m/m, m/N]."""
    points = inside(_DRAWN, problem.quantities, _SEED)
    names = list(Uncertainty.model_fields)
    # masses and dampings at their ends; frequencies anywhere, since a resonance may lie between
    between = [k for k in range(problem.quantities)
               if (names[k] in ("frequency", "detuning") if k < len(names) else (k - len(names)) % 3 == 1)]  # fmt: skip
    ends = np.sign(points)
    ends[:, between] = points[:, between]
    found = []
    for point, drawn in zip(ends, drawn_frequencies(problem, len(ends), _SEED), strict=True):
        off = deviation(problem, point)
        modes = modes_of(problem, fraction, off)
        assert modes is not None
        at = (modes.joined.frequencies[0] if drawn is None else drawn) * (1.0 + off.detuning)
        found.append((1.0 + off.amplitude) * abs(phasors(modes.free, at).sum()))
    return float(min(found)), float(max(found))
