# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A linear oscillator with a stop: closed forms of grazing, and of the motion with one impact a period.

A structure of modes q, whose displacement x = sum(q) is bounded by x <= gap, repeats itself without impact as long as
the amplitude R of x is below the gap; at R = gap it grazes. Beyond, free flight would pass the gap by y, and the impact
at the speed v = sqrt(2 a y), a = R omega^2, turns it back: the section state takes the additional term
-(1 + e) sqrt(2 a y) N b, where N is the flow from the impact to the section and b the velocities that an impulse of one
unit of speed at x gives the modes (the discontinuity map of A. B. Nordmark, J. Sound Vib. 145 (1991) 279;
M. di Bernardo and others, Piecewise-smooth Dynamical Systems, 2008, chapter 6).

Of one mode the motion with one impact a period is known for any speed (S. W. Shaw and P. J. Holmes, J. Sound Vib. 90
(1983) 129), and so are its fold and its multipliers, whose trace has the term -(1 + e) a N_12 / v. With a frequency of
the drive near that of the damped oscillator N_12 vanishes, and the fold is tangent to grazing in the square of the
distance, as D. J. W. Simpson and I. Ghosh prove (arXiv 2602.22797); the coefficient follows here from the closed form.
"""

import math
from typing import NamedTuple

import numpy as np

from atpid_sim.system import Array


def flow(omegas: Array, ratios: Array, duration: float) -> Array:
    """Return the matrix (2 n, 2 n) by which displacements and velocities of free modes change in a duration [s]."""
    matrix = np.zeros((2 * len(omegas), 2 * len(omegas)))
    for k, (omega, ratio) in enumerate(zip(omegas.tolist(), ratios.tolist(), strict=True)):
        decay, damped = ratio * omega, omega * math.sqrt(1.0 - ratio**2)
        c, s = math.cos(damped * duration), math.sin(damped * duration) / damped
        own = np.array([[c + decay * s, s], [-(omega**2) * s, c - decay * s]])
        matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = math.exp(-decay * duration) * own
    return matrix


def square_root_term(masses: Array, to_section: Array, restitution: float, speed: float) -> Array:
    """Return what an impact at a small speed [m/s] adds to the section state (2 n,); to_section: the flow to it."""
    kick = np.zeros(2 * len(masses))
    kick[1::2] = 1.0 / masses / np.sum(1.0 / masses)
    term: Array = -(1.0 + restitution) * speed * (to_section @ kick)
    return term


class OneImpact(NamedTuple):
    """One mode that strikes the stop once a period; lengths over the amplitude R without the stop."""

    omega: float  # of the mode, without damping [rad/s]
    ratio: float  # damping over critical
    restitution: float
    drive: float  # angular frequency of the drive [rad/s]

    @property
    def period_flow(self) -> Array:
        """Flow (2, 2) over a period of the drive."""
        return flow(np.array([self.omega]), np.array([self.ratio]), 2.0 * math.pi / self.drive)

    @property
    def deviation(self) -> Array:
        """Gap less the displacement without stop (0), less its velocity (1), at the impact, over the impact's speed."""
        n, e = self.period_flow, self.restitution
        found: Array = np.linalg.solve(n - np.eye(2), (np.eye(2) + e * n) @ np.array([0.0, 1.0]))
        return found

    def gap(self, speed: float) -> float:
        """Return the gap at which the impact has a speed [1/s]."""
        u, w = self.deviation
        return float(u * speed + math.sqrt(1.0 - (w * speed / self.drive) ** 2))

    @property
    def fold(self) -> tuple[float, float]:
        """Largest gap that the motion strikes, and the speed of the impact there [1/s]; needs u > 0."""
        u, b = self.deviation[0], abs(self.deviation[1]) / self.drive
        return math.hypot(1.0, u / b), u / (b * math.hypot(u, b))

    @property
    def tangency(self) -> float:
        """Largest gap less 1 over the square of drive / damped frequency - 1, in the limit of a drive at it."""
        damped = self.omega * math.sqrt(1.0 - self.ratio**2)
        rest = math.exp(-2.0 * math.pi * self.ratio * self.omega / damped)
        slope = 2.0 * math.pi * rest * (1.0 + self.restitution) / (1.0 - rest) / (1.0 + self.restitution * rest)
        return 0.5 * slope**2

    def multipliers(self, speed: float) -> Array:
        """Return both multipliers of the motion whose impact has a speed [1/s], the larger modulus first."""
        e, (u, w) = self.restitution, self.deviation * speed
        decay = 2.0 * self.ratio * self.omega
        # accelerations before and after, of the motion without stop and of the deviation from it
        without = -(self.drive**2) * (self.gap(speed) - u)
        before, after = (without - decay * (v + w) - self.omega**2 * u for v in (speed, -e * speed))
        passed = np.array([[-e, 0.0], [(after + e * before) / speed, -e]])
        found = np.linalg.eigvals(self.period_flow @ passed)
        ordered: Array = found[np.argsort(-np.abs(found))]
        return ordered

    def section(self, speed: float) -> tuple[float, Array]:
        """Return a quarter of a period after the impact: phase of x without stop (0: rising through 0), and (x, v)."""
        u, w = self.deviation * speed
        struck = math.atan2(self.gap(speed) - u, -w / self.drive)  # sine and cosine of the phase
        quarter = 0.5 * math.pi / self.drive
        own = flow(np.array([self.omega]), np.array([self.ratio]), quarter) @ [u, w - self.restitution * speed]
        phase = struck + 0.5 * math.pi
        return phase, np.array([math.sin(phase), self.drive * math.cos(phase)]) + own
