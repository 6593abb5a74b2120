# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two impacts a cycle in closed form: a grain without weight between two walls (Masri and Caughey 1966).

The primary mass obeys x'' + 2 zeta x' + x = sin(r t + phase) with m = k = A = 1; the grain, mu times as heavy, flies at
constant speed between walls a clearance d apart and leaves them with restitution e. In the symmetric motion it strikes
floor and ceiling in turn, half a period apart.

The fixed gap for one amplitude of the support: without gravity the amplitude of the beam falls with the clearance
almost up to the largest at which the symmetric motion exists, d = 2 X_s sqrt(1 + (a / b)^2) (`longest_clearance`); just
below it the motion loses its stability. The gap taken is the stable one with the least amplitude. It is in proportion
to the excitation, so that a fixed gap is right at one amplitude only (On the stability of the impact damper, J. Appl.
Mech. 33, 1966, 586-592).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from atpid_sim.system import Array, System


@dataclass(frozen=True)
class TwoImpacts:
    """The system, dimensionless."""

    mass_ratio: float  # mu, grain over primary mass
    restitution: float
    clearance: float  # d / A
    damping_ratio: float = 0.01
    frequency_ratio: float = 1.0  # r

    @property
    def half_period(self) -> float:
        """Half a period of the excitation."""
        return math.pi / self.frequency_ratio

    def _free(self, t: float) -> Array:
        """Return the matrix (2, 2) that takes displacement and velocity of the free primary mass over t."""
        z = self.damping_ratio
        w = math.sqrt(1.0 - z * z)
        c, s, decay = math.cos(w * t), math.sin(w * t), math.exp(-z * t)
        return decay * np.array([[c + z / w * s, s / w], [-s / w, c - z / w * s]])

    def _forced(self, phase: float) -> Array:
        """Return steady displacement and velocity (2,) of the primary mass without grain at a phase of the force."""
        r, z = self.frequency_ratio, self.damping_ratio
        response = np.exp(1j * phase) / (1.0 - r * r + 2j * z * r)
        return np.array([response.imag, r * response.real])

    def motion(self, t: float, phase: float, start: Array) -> Array:
        """Return displacement and velocity (2,) at t, from `start` (2,) at phase `phase` of the force at t = 0."""
        steady = self._forced(phase + self.frequency_ratio * t)
        return np.asarray(steady + self._free(t) @ (start - self._forced(phase)))


@dataclass(frozen=True)
class Symmetric:
    """A symmetric motion, just after the impact on the floor."""

    phase: float  # of the force [rad]
    start: Array  # displacement and velocity of the primary mass (2,)
    grain: float  # velocity of the grain
    peak: float  # largest displacement of the primary mass
    multiplier: float  # largest modulus of the return map's multipliers: stable below 1


def symmetric_motions(system: TwoImpacts) -> list[Symmetric]:
    """Return the symmetric motions of a system, at most two.

    With the grain's speed w after the floor, momentum and restitution give the velocities of the primary mass before
    and after the impact, both in proportion to w; antisymmetry gives its free part, likewise; what is left of it is the
    steady response, whose amplitude is known: a quadratic equation for w.
    """
    free, a, b = _terms(system)
    r = system.frequency_ratio
    half = 0.5 * system.clearance
    steady = _steady_amplitude(system)
    roots = np.roots([a * a + b * b, 2.0 * a * half, half * half - steady * steady])
    speeds = sorted(float(root.real) for root in roots if abs(root.imag) < 1e-12 and root.real > 0.0)
    return [_symmetric(system, w, half + a * w, r * b * w, w * free) for w in speeds]


def longest_clearance(system: TwoImpacts) -> float:
    """Return the clearance d / A [-] beyond which no symmetric motion exists; that of `system` is not used.

    The quadratic equation for the grain's speed, (a^2 + b^2) w^2 + a d w + d^2 / 4 = X_s^2, has real roots up to
    d = 2 X_s sqrt(1 + (a / b)^2), X_s being the steady amplitude of the primary mass without the grain.
    """
    _, a, b = _terms(system)
    return 2.0 * _steady_amplitude(system) * math.hypot(1.0, a / b)


def _terms(system: TwoImpacts) -> tuple[Array, float, float]:
    """Return free part (2,) and the steady part's share of displacement and of velocity over r, all for w = 1."""
    e, mu, t, r = system.restitution, system.mass_ratio, system.half_period, system.frequency_ratio
    before = (1.0 - e + 2.0 * mu) / (1.0 + e)
    free = np.linalg.solve(np.eye(2) + system._free(t), np.array([0.0, -2.0 * mu]))
    # steady part at the impact: displacement d/2 - (t/2 + free) w, velocity (before - 2 mu - free) w
    return free, -(0.5 * t + float(free[0])), (before - 2.0 * mu - float(free[1])) / r


def _steady_amplitude(system: TwoImpacts) -> float:
    """Return the steady amplitude of the primary mass without grain."""
    return float(np.hypot(*(system._forced(0.0) / np.array([1.0, system.frequency_ratio]))))


def _symmetric(system: TwoImpacts, w: float, steady: float, rate: float, free: Array) -> Symmetric:
    """Return the motion with grain speed w, steady displacement and rate and the free part (2,) at the impact."""
    reference = system._forced(0.0)
    r = system.frequency_ratio
    phase = math.atan2(steady, rate / r) - math.atan2(reference[0], reference[1] / r)
    start = np.array([steady, rate]) + free
    times = np.linspace(0.0, system.half_period, 400)
    top = times[int(np.argmax([abs(system.motion(t, phase, start)[0]) for t in times]))]
    found = minimize_scalar(
        lambda t: -abs(system.motion(t, phase, start)[0]),
        bounds=(max(top - 0.02, 0.0), min(top + 0.02, system.half_period)),
        method="bounded", options={"xatol": 1e-12},
    )  # fmt: skip
    multipliers = np.linalg.eigvals(return_map_slope(system, phase, start, w))
    return Symmetric(phase, start, w, -float(found.fun), float(np.abs(multipliers).max()))


def half_return(system: TwoImpacts, state: Array) -> Array:
    """Return the state (4,) after the next impact, mirrored: phase, displacement, velocity, velocity of the grain."""
    phase, start, w = state[0], state[1:3], state[3]
    t0 = system.half_period

    def gap(t: float) -> float:
        return float(start[0] + w * t - system.motion(t, phase, start)[0] - system.clearance)

    t = brentq(gap, 0.7 * t0, 1.3 * t0, xtol=1e-14)
    x, v = system.motion(t, phase, start)
    mu, e = system.mass_ratio, system.restitution
    common = (v + mu * w) / (1.0 + mu)
    after, grain = common + mu * e / (1.0 + mu) * (w - v), common - e / (1.0 + mu) * (w - v)
    return np.array([phase + system.frequency_ratio * t - math.pi, -x, -after, -grain])


def return_map_slope(system: TwoImpacts, phase: float, start: Array, grain: float) -> Array:
    """Return the derivative (4, 4) of `half_return` at a state by central differences."""
    state = np.array([phase, *start, grain])
    columns = []
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-6
        columns.append((half_return(system, state + step) - half_return(system, state - step)) / 2e-6)
    return np.array(columns).T


#: Clearances tried, as shares of the longest.
_STEP, _COUNT = 0.005, 80


@dataclass(frozen=True)
class MasriGap:
    """The gap, over the support's amplitude, and what the theory predicts there."""

    clearance: float  # gap less grain diameter, over the support's amplitude [-]
    peak: float  # largest displacement of the beam over the support's amplitude [-]
    multiplier: float  # largest modulus of the return map's multipliers [-]


def masri_gap(system: System, frequency: float, restitution: float) -> MasriGap | None:
    """Return the clearance of the stable symmetric motion with the least peak; None where no motion is stable.

    frequency: of the excitation [Hz]; restitution of grain and walls [-]. Gravity is left out.
    """
    natural = math.sqrt(system.stiffness / system.beam_mass)
    ratio = 2.0 * math.pi * frequency / natural
    damping = system.damping / (2.0 * math.sqrt(system.stiffness * system.beam_mass))
    # the support drives through spring and damper: force over stiffness, for a support amplitude of one
    force = abs(complex(1.0, 2.0 * damping * ratio))
    theory = TwoImpacts(system.grain_mass / system.beam_mass, restitution, 1.0, damping, ratio)
    longest = longest_clearance(theory)
    stable = [
        MasriGap(clearance * force, motion.peak * force, motion.multiplier)
        for clearance in (longest * (1.0 - _STEP * k) for k in range(1, _COUNT))
        for motion in _motions(replace(theory, clearance=clearance))
        if motion.multiplier < 1.0
    ]
    return min(stable, key=lambda gap: gap.peak, default=None)


def _motions(theory: TwoImpacts) -> list[Symmetric]:
    """Return the symmetric motions; none where the grain of one would strike at another time than it was assumed to."""
    try:
        return symmetric_motions(theory)
    except ValueError:
        return []
