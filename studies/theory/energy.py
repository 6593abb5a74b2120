# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Energy of the beam and work on it, integrated over the motion itself (Eqs 3.55 to 3.70).

The thesis had to take the work of contacts as the remainder of the balance (section 3.6.2). Here the contact force
follows from the beam's acceleration, so that it is integrated like every other work, and the balance is a check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from atpid_sim.system import Array


@dataclass(frozen=True)
class Structure:
    """The beam's constants."""

    mass: float  # m_s, without the grain [kg]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    gravity: float  # [m/s^2]
    rest: float  # displacement of the beam at rest [m]


@dataclass(frozen=True)
class BeamMotion:
    """Series (n,) at equal intervals: time [s], support, displacement, velocity, acceleration (SI)."""

    time: Array
    support: Array
    displacement: Array
    velocity: Array
    acceleration: Array

    def between(self, begin: float, end: float) -> BeamMotion:
        """Return the part from `begin` to `end` [s]."""
        kept = (self.time >= begin) & (self.time <= end)
        series = (self.time, self.support, self.displacement, self.velocity, self.acceleration)
        return BeamMotion(*(values[kept] for values in series))


def spring_force(beam: Structure, motion: BeamMotion) -> Array:
    """Return the force of spring and damper on the beam (n,) [N], minus F_ext of Eq. 3.43."""
    support_velocity = np.gradient(motion.support, motion.time)
    return -beam.stiffness * (motion.displacement - motion.support) - beam.damping * (
        motion.velocity - support_velocity
    )


def contact_force(beam: Structure, motion: BeamMotion) -> Array:
    """Return F_c1 - F_c2 (n,) [N] from the beam's equation of motion: positive while the floor is in contact."""
    return spring_force(beam, motion) - beam.mass * (motion.acceleration + beam.gravity)


def summary_energy(beam: Structure, motion: BeamMotion) -> Array:
    """Return kinetic energy and that of position (n,) [J], the latter 0 at rest (Figs 3.18 and 3.19)."""
    return 0.5 * beam.mass * motion.velocity**2 + beam.mass * beam.gravity * (motion.displacement - beam.rest)


def total_energy(beam: Structure, motion: BeamMotion) -> Array:
    """Return E_tot of the beam (n,) [J]: kinetic, elastic and of position, 0 at rest (Eq. 3.57, Fig. 3.10)."""
    shift = motion.displacement - beam.rest
    # spring and weight together: the elastic energy about the equilibrium
    return 0.5 * beam.mass * motion.velocity**2 + 0.5 * beam.stiffness * (shift - motion.support) ** 2


def grain_energy(mass: float, gravity: float, time: Array, displacement: Array) -> Array:
    """Return kinetic energy and that of position of the grain (n,) [J] from its displacement (n,) [m] (Eq. 3.66)."""
    velocity = np.gradient(displacement, time)
    return np.asarray(0.5 * mass * velocity**2 + mass * gravity * displacement)


def work_of_excitation(beam: Structure, motion: BeamMotion) -> Array:
    """Return the work of spring and damper on the beam (n,) [J] since the first sample, W_Fext of Eq. 3.65."""
    return _work(spring_force(beam, motion), motion)


def work_on_grain(beam: Structure, motion: BeamMotion) -> Array:
    """Return the work the beam does on the contacts (n,) [J] since the first sample, minus W_Fc of Eq. 3.68."""
    return _work(contact_force(beam, motion), motion)


def balance_residual(beam: Structure, motion: BeamMotion) -> float:
    """Return what Eq. 3.65 leaves [-]: the largest of dE_k + dE_p - W_Fext - W_Fc over the largest of its terms."""
    energy = summary_energy(beam, motion)
    terms = (energy - energy[0], -work_of_excitation(beam, motion), work_on_grain(beam, motion))
    return float(np.abs(sum(terms)).max() / max(np.abs(term).max() for term in terms))


def impact_span(force: Array, start: int, longest: int) -> tuple[int, int]:
    """Return the first and last sample of an impact that begins near sample `start` in a contact force (n,) [N].

    It ends where the force has come back to a hundredth of its peak, at the latest after `longest` samples.
    """
    begin = max(start - 1, 0)
    piece = np.abs(force[begin : begin + longest])
    top = int(np.argmax(piece))
    below = np.flatnonzero(piece[top:] < 0.01 * piece[top])
    return begin, begin + top + (int(below[0]) if len(below) else len(piece) - 1 - top)


def _work(force: Array, motion: BeamMotion) -> Array:
    return np.asarray(cumulative_trapezoid(force * motion.velocity, motion.time, initial=0.0))


def natural_frequency(mass: float, stiffness: float) -> float:
    """Return the natural frequency [Hz] of a mass [kg] on a spring [N/m] (Eq. 3.45)."""
    return float(np.sqrt(stiffness / mass) / (2.0 * np.pi))
