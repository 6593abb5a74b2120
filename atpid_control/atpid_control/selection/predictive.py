# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simplified and Predictive Model of the PCA (thesis section 4.4, equations 4.7 to 4.32): closed forms, no simulation.

Displacements are measured from the bare beam's equilibrium. In the thesis's equation 4.11 m_b is m_g: the excitation is
at the resonance of beam and grain together; here it is at whatever frequency is given, which changes the beam's
amplitude (`moving_mass`).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_sim.modal import modes_in, phasors, resting
from atpid_sim.system import System, structure_of

#: Halvings of half a period when the grain's return to the floor is sought.
_BISECTIONS = 60


@dataclass(frozen=True)
class Impact:
    """The moment after an impact on the floor, input of the Predictive Model."""

    beam: float  # displacement [m]
    beam_velocity: float  # [m/s]
    grain_velocity: float  # [m/s]


@dataclass(frozen=True)
class Simplified:
    """The beam's steady response x = A_pred sin(omega t) (equation 4.19)."""

    amplitude: float  # A_pred [m]
    omega: float  # of the excitation [rad/s]
    gravity: float  # [m/s^2]
    radius: float  # of the grain [m]

    @property
    def top_speed(self) -> float:
        """V_k0 of the first iteration (equation 4.25 at t_c1 = 0) [m/s]."""
        return self.omega * self.amplitude

    def displacement(self, t: float) -> float:
        """Displacement of the floor [m] at time t [s]."""
        return self.amplitude * math.sin(self.omega * t)

    def velocity(self, t: float) -> float:
        """Velocity of the floor [m/s] at time t [s]."""
        return self.top_speed * math.cos(self.omega * t)

    def height(self, floor: float, grain_velocity: float, t_floor: float, t_ceiling: float) -> float:
        """Return h_pred [m] for a grain that leaves the floor at `floor` [m] with `grain_velocity` [m/s] (eq. 4.29)."""
        flight = t_ceiling - t_floor
        risen = grain_velocity * flight - 0.5 * self.gravity * flight**2
        return 2.0 * self.radius + floor + risen - self.displacement(t_ceiling)

    def first_height(self) -> float:
        """Return the first guess [m]: floor struck at t = 0, ceiling half a period later, at top speed (eq. 4.30)."""
        return self.height(0.0, self.top_speed, 0.0, math.pi / self.omega)

    def next_height(self, last: Impact) -> float:
        """Return the next guess [m] from the end of the last impact on the floor (equations 4.31 and 4.32).

        Equation 4.32 is solved within a quarter of a period around t = 0; where the beam is further out than the
        Simplified Model ever goes, at the end of that range.
        """
        t_floor = math.asin(min(max(last.beam / self.amplitude, -1.0), 1.0)) / self.omega
        return self.height(last.beam, last.grain_velocity, t_floor, math.pi / self.omega)

    def first_return(self, height: float) -> tuple[float, Impact]:
        """Return when [s] and how a grain thrown down by the ceiling at `height` [m] meets the floor (Fig. 4.25).

        Beyond the ceiling the grain has the beam's velocity, as it had beyond the floor.
        """
        start = math.pi / self.omega
        clearance = height - 2.0 * self.radius

        def gap(t: float) -> float:
            fall = t - start
            return clearance - self.top_speed * fall - 0.5 * self.gravity * fall**2 - self.displacement(t)

        left, right = start, 2.0 * start
        while gap(right) > 0.0:
            right += start
        for _ in range(_BISECTIONS):
            middle = 0.5 * (left + right)
            left, right = (middle, right) if gap(middle) > 0.0 else (left, middle)
        return right, Impact(
            self.displacement(right), self.velocity(right), -self.top_speed - self.gravity * (right - start)
        )


def simplified(system: System, frequency: float, amplitude: float) -> Simplified:
    """Return the Simplified Model for a support amplitude [m] at a frequency [Hz] (equations 4.13 to 4.20)."""
    omega = 2.0 * math.pi * frequency
    if system.modes is not None:
        response = amplitude * abs(modal_response(system, frequency).sum())
        return Simplified(float(response), omega, system.gravity, system.radius)
    mass = moving_mass(system, frequency)
    natural = math.sqrt(system.stiffness / mass)
    decay = 0.5 * system.damping / mass
    force = amplitude * math.hypot(system.stiffness, system.damping * omega)
    stiffness = mass * math.hypot(2.0 * decay * omega, omega**2 - natural**2)
    return Simplified(force / stiffness, omega, system.gravity, system.radius)


def response_lag(system: System, frequency: float) -> float:
    """Return how far the Simplified Model's beam lags behind the support [rad].

    The thesis sets this phase to zero; the Complex Model needs the true one, or its first period is not a continuation.
    """
    if system.modes is not None:
        whole = complex(modal_response(system, frequency).sum())
        return -math.atan2(whole.imag, whole.real)
    omega = 2.0 * math.pi * frequency
    force = complex(system.stiffness, system.damping * omega)
    ratio = force / _resistance(system, moving_mass(system, frequency), omega)
    return -math.atan2(ratio.imag, ratio.real)


def modal_response(system: System, frequency: float) -> NDArray[np.complex128]:
    """Return the displacement of each mode (modes,) over the drive's amplitude: of `moving_mass` for several modes."""
    modes = modes_in(system.modes)
    alone, closed = phasors(modes.free, frequency), modes.from_joined @ phasors(modes.joined, frequency)
    return min(alone, closed, key=lambda each: abs(each.sum()))


def equilibrium(system: System) -> float:
    """Return how far the structure's weight pulls it down without the grain [m], where displacements count from."""
    return -float(resting(structure_of(system, held=False)).sum())


def moving_mass(system: System, frequency: float) -> float:
    """Return the mass [kg] of which the Simplified Model is the response, (k + i c w) / (k - m w^2 + i c w).

    That of the bare beam, as in the thesis, whose equations hold at resonance of beam and grain. Above, towards its own
    resonance, the bare beam would swing without limit, and a damper leaves it less than the closed one: where beam and
    grain as one mass respond less, it is theirs.
    """
    omega, both = 2.0 * math.pi * frequency, system.beam_mass + system.grain_mass
    return max((system.beam_mass, both), key=lambda mass: abs(_resistance(system, mass, omega)))


def _resistance(system: System, mass: float, omega: float) -> complex:
    return complex(system.stiffness - mass * omega**2, system.damping * omega)
