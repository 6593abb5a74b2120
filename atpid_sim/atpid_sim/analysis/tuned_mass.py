# SPDX-License-Identifier: Apache-2.0
"""A tuned mass damper on a damped beam with a moving support, in closed form: the passive device damper is compared to.

Everything is over the beam alone: frequencies over its natural frequency, damping over its critical damping, absolute
displacements over that of the support. With an undamped beam the absolute displacement is that of Den Hartog's mass
under a force (Mechanical Vibrations, 4th edition, section 3.3), since the support drives it through the spring alone.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from atpid_sim.system import Array

#: Frequency ratios among which a peak is looked for, and how many.
_LOW, _HIGH, _COUNT = 0.3, 2.0, 1701


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

    def beam(self, ratio: float | Array) -> Array:
        """Return the beam's amplitude over the support's, shape of `ratio` [-], the excitation's frequency ratio."""
        return np.abs(self._beam(np.asarray(ratio, dtype=float)))

    def stroke(self, ratio: float | Array) -> Array:
        """Return the amplitude of the tuned mass against the beam over the support's, shape of `ratio` [-]."""
        r = np.asarray(ratio, dtype=float)
        return np.asarray(np.abs(self._beam(r) * r * r / (self._spring(r) - r * r)))

    def peak(self) -> float:
        """Return the largest amplitude of the beam over the support's at any frequency [-]."""
        ratios = np.linspace(_LOW, _HIGH, _COUNT)
        values = self.beam(ratios)
        tops = 1 + np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:]))
        refined = (
            minimize_scalar(
                lambda r: -float(self.beam(r)), bounds=(ratios[k - 1], ratios[k + 1]), method="bounded",
                options={"xatol": 1e-10},
            ).fun
            for k in tops
        )  # fmt: skip
        return float(max([-value for value in refined], default=values.max()))

    def _spring(self, r: Array) -> Array:
        """Return the complex stiffness of the tuned mass's spring and damper, over m_a omega_beam^2."""
        return np.asarray(self.tuning.frequency**2 + 2j * self.tuning.damping * r)

    def _beam(self, r: Array) -> Array:
        spring = self._spring(r)
        carried = self.mass_ratio * r * r * spring / (spring - r * r)
        support = 1.0 + 2j * self.damping_ratio * r
        return np.asarray(support / (support - r * r - carried))


def den_hartog(mass_ratio: float) -> Tuning:
    """Return Den Hartog's tuning, which ignores the beam's damping: equal fixed points, Brock's damping.

    f = 1 / (1 + mu), zeta^2 = 3 mu / (8 (1 + mu)^3); the peak on an undamped beam is close to sqrt(1 + 2 / mu).
    """
    return Tuning(1.0 / (1.0 + mass_ratio), math.sqrt(3.0 * mass_ratio / (8.0 * (1.0 + mass_ratio) ** 3)))


def optimised(mass_ratio: float, damping_ratio: float) -> Tuning:
    """Return the tuning whose largest amplitude over all frequencies is least, the beam's damping included."""
    start = den_hartog(mass_ratio)

    def peak(x: Array) -> float:
        return TunedBeam(mass_ratio, damping_ratio, Tuning(float(x[0]), abs(float(x[1])))).peak()

    found = minimize(
        peak, [start.frequency, start.damping], method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-11, "initial_simplex": _around(start)},
    )  # fmt: skip
    return Tuning(float(found.x[0]), abs(float(found.x[1])))


def exact_undamped(mass_ratio: float) -> tuple[Tuning, float]:
    """Return the exact optimum on an undamped beam and its peak [-].

    Nishihara and Asami, Closed-form solutions to the exact optimizations of dynamic vibration absorbers, J. Vib.
    Acoust. 124, 2002, 576-582.
    """
    mu = mass_ratio
    root = math.sqrt(4.0 + 3.0 * mu)
    frequency = (2.0 / (1.0 + mu)) * math.sqrt(
        2.0 * (16.0 + 23.0 * mu + 9.0 * mu**2 + 2.0 * (2.0 + mu) * root) / (3.0 * (64.0 + 80.0 * mu + 27.0 * mu**2))
    )
    damping = 0.25 * math.sqrt((8.0 + 9.0 * mu - 4.0 * root) / (1.0 + mu)) * frequency
    over = (8.0 + 9.0 * mu) ** 2 * (16.0 + 9.0 * mu) - 128.0 * root**3
    peak = math.sqrt(over / (3.0 * (32.0 + 27.0 * mu))) / (3.0 * mu)
    return Tuning(frequency, damping), peak


def _around(start: Tuning) -> Array:
    f, z = start.frequency, start.damping
    return np.array([[f, z], [1.01 * f, z], [f, 1.1 * z]])
