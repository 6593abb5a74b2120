# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The equations of several dampers written down once more: impacts found by scipy, or stiff linear contacts.

They share the scene's numbers with the engine, and nothing else. The mass matrix is that of modes and grains at rest.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from atpid_sim.scene import Scene
from atpid_sim.system import Array

Flags = NDArray[np.bool_]

#: Relative tolerance and longest step [s] of scipy; the closing speed below which a grain stays at its wall [m/s].
_RTOL, _LONGEST, _SLOW = 1e-10, 1e-3, 1e-5
#: How far off a wall a grain is put after an impact, so that the next event is another one [m].
_OFF = 1e-13
#: A wall that pulls more than this is left [m/s^2].
_PULL = 1e-9
#: A grain this near its wall lands with one that does [m].
_LANDED = 1e-11
#: Events of a run at most.
_EVENTS = 2500
#: Impacts of one instant at most before all is plastic.
_ROUNDS = 60


class Structure(NamedTuple):
    """The scene's numbers."""

    mass: Array  # (modes,) each
    stiffness: Array
    damping: Array
    direct: Array
    rate: Array
    grains: Array  # (dampers,) each
    clearance: Array
    shapes: Array  # (dampers, modes)
    gravity: float
    omega: float
    size: float

    @classmethod
    def of(cls, scene: Scene) -> "Structure":
        """Return those of a scene with a constant tone and a fixed ceiling."""
        modes = [scene.beam, *scene.further_modes]
        mass, stiffness, damping = (
            np.array([getattr(mode, name) for mode in modes]) for name in ("mass", "stiffness", "damping")
        )
        factors = np.array([1.0, *(mode.drive_factor for mode in scene.further_modes)])
        direct, rate = factors, 0.0 * factors
        if scene.drive == "support":
            factors[0] -= factors[1:].sum()
            direct, rate = factors * stiffness, factors * damping
        grains = [
            (scene.grain.mass_fraction, scene.ceiling.heights[0][1] - 2.0 * scene.grain.radius, np.ones(len(mass)))
        ]
        for one in scene.further_dampers:
            clearance = one.height - 2.0 * (one.radius or scene.grain.radius)
            grains += one.count * [(one.mass_fraction, clearance, np.array(one.shapes or np.ones(len(mass))))]
        return cls(
            mass, stiffness, damping, direct, rate,
            np.array([scene.beam.mass * fraction / (1.0 - fraction) for fraction, _, _ in grains]),
            np.array([clearance for _, clearance, _ in grains]), np.array([shape for _, _, shape in grains]),
            scene.gravity, 2.0 * math.pi * scene.frequency_hz, scene.excitation.amplitude_points[0][1],
        )  # fmt: skip

    def start(self) -> Array:
        """Return the state at rest: modes, their rates, grains, their velocities."""
        weight = self.shapes.T @ self.grains * self.gravity
        weight[0] += self.mass[0] * self.gravity
        q = -weight / self.stiffness
        return np.concatenate((q, 0.0 * q, self.shapes @ q, np.zeros(len(self.grains))))

    def accelerations(self, t: float, q: Array, rate: Array, held: Flags) -> Any:
        """Return those of the modes (modes,) with the grains `held` (dampers,) of bool as part of the structure."""
        u, w = self.size * math.sin(self.omega * t), self.size * self.omega * math.cos(self.omega * t)
        force = self.direct * u + self.rate * w - self.stiffness * q - self.damping * rate
        force[0] -= self.mass[0] * self.gravity
        matrix = np.diag(self.mass)
        for j in map(int, np.flatnonzero(held)):
            force = force - self.grains[j] * self.gravity * self.shapes[j]
            matrix = matrix + self.grains[j] * np.outer(self.shapes[j], self.shapes[j])
        return np.linalg.solve(matrix, force)


def with_impacts(  # noqa: C901 one run, as it is written down
    scene: Scene, restitution: float, times: Array
) -> Array | None:
    """Return the first container's displacement at `times` (n,) [s]; None: bounces without end."""
    s = Structure.of(scene)
    n, count = len(s.mass), len(s.grains)
    z, t = s.start(), 0.0
    side = np.ones(count)  # of the wall that a grain rests on
    held, found = np.ones(count, bool), np.zeros(len(times))
    clamped = s.clearance <= 1e-9
    done, end = 0, float(times[-1])

    def derivative(t: float, z: Array) -> Array:
        a = s.accelerations(t, z[:n], z[n : 2 * n], held)
        grains = np.where(held, s.shapes @ a, -s.gravity)
        return np.concatenate((z[n : 2 * n], a, z[2 * n + count :], grains))

    def walls(j: int, z: Array) -> tuple[float, float]:
        gap = float(z[2 * n + j] - s.shapes[j] @ z[:n])
        return gap, float(s.clearance[j]) - gap

    def event(j: int, which: int) -> Any:
        def value(t: float, z: Array) -> float:
            if which < 2:
                return 1.0 if held[j] else walls(j, z)[which]
            if not held[j] or clamped[j]:
                return 1.0
            press = side[j] * (s.shapes[j] @ s.accelerations(t, z[:n], z[n : 2 * n], held) + s.gravity)
            return float(press + _PULL)

        value.terminal, value.direction = True, -1  # type: ignore[attr-defined]
        return value

    events = [event(j, which) for j in range(count) for which in range(3)]
    for _ in range(_EVENTS):
        for j in map(int, np.flatnonzero(held)):  # exactly at the wall
            z[2 * n + j] = s.shapes[j] @ z[:n] + (0.0 if side[j] > 0.0 else s.clearance[j])
            z[2 * n + count + j] = s.shapes[j] @ z[n : 2 * n]
        while True:  # who is pressed on
            a = s.accelerations(t, z[:n], z[n : 2 * n], held)
            press = np.where(held & ~clamped, side * (s.shapes @ a + s.gravity), 1.0)
            if press.min() >= -0.5 * _PULL:
                break
            held[press.argmin()] = False
        for j in map(int, np.flatnonzero(~held)):
            below, above = walls(j, z)
            z[2 * n + j] += max(0.0, _OFF - below) - max(0.0, _OFF - above)
        motion = solve_ivp(
            derivative, (t, end), z, "DOP853", rtol=_RTOL, atol=1e-13, events=events, max_step=_LONGEST,
            dense_output=True,
        )  # fmt: skip
        last = int(np.searchsorted(times, motion.t[-1], side="right"))
        if last > done:
            found[done:last] = s.shapes[0] @ motion.sol(times[done:last])[:n]
        done = max(done, last)
        t, z = float(motion.t[-1]), motion.y[:, -1].copy()
        if motion.status == 0:
            return found
        for number, when in enumerate(motion.t_events):
            j, which = divmod(number, 3)
            if len(when) and which == 2:
                held[j] = False
            elif len(when):
                side[j] = 1.0 if which == 0 else -1.0
                _struck(s, z, side, held, clamped, j, restitution)

    return None


def _struck(s: Structure, z: Array, side: Array, held: Flags, clamped: Flags, first: int, e: float) -> None:
    """Let the grain `first`, and those that land with it, strike their walls, then those that this makes others meet.

    The fastest come first, those of one closing speed together.
    """
    n, count = len(s.mass), len(s.grains)
    matrix = np.diag(s.mass) + sum(s.grains[j] * np.outer(s.shapes[j], s.shapes[j]) for j in np.flatnonzero(clamped))
    touching, gaps = held.copy(), z[2 * n : 2 * n + count] - s.shapes @ z[:n]
    side[~held & (gaps <= _LANDED)], side[~held & (s.clearance - gaps <= _LANDED)] = 1.0, -1.0
    touching |= (gaps <= _LANDED) | (s.clearance - gaps <= _LANDED)
    touching[first] = True
    for lap in range(_ROUNDS):
        closing = side * (s.shapes @ z[n : 2 * n] - z[2 * n + count :])
        closing[~touching | clamped] = 0.0
        if closing.max() <= 1e-12:
            break
        together = closing >= (1.0 - 1e-6) * closing.max()
        own = np.where((closing < _SLOW) | (lap > _ROUNDS // 2), 0.0, e)
        response = np.linalg.solve(matrix, (s.shapes[together] * side[together, None]).T)
        meets = (s.shapes[together] * side[together, None]) @ response + np.diag(1.0 / s.grains[together])
        impulse = np.maximum(np.linalg.solve(meets, (1.0 + own[together]) * closing[together]), 0.0)
        z[n : 2 * n] -= response @ impulse
        z[2 * n + count :][together] += side[together] * impulse / s.grains[together]
    parting = side * (z[2 * n + count :] - s.shapes @ z[n : 2 * n])
    held[touching] = clamped[touching] | (parting[touching] <= 0.3 * _SLOW)


@njit(cache=False)
def _contacts(  # type: ignore[no-untyped-def]  # noqa: C901, PLR0913 compiled: plain numbers and arrays
    mass, stiffness, damping, direct, rate, grains, clearance, shapes, gravity, omega, size, k, c, z, t, h, n
):
    """Displacement of the first container at the ends of n steps by Runge and Kutta's method, linear contacts."""
    modes, count = len(mass), len(grains)
    out, slopes, here = np.empty(n), np.empty((4, len(z))), np.empty(len(z))
    for step in range(n):
        for stage in range(4):
            share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for i in range(len(z)):
                here[i] = z[i] + (share * h * slopes[stage - 1, i] if stage > 0 else 0.0)
            now = t + share * h
            u, w = size * math.sin(omega * now), size * omega * math.cos(omega * now)
            d = slopes[stage]
            for i in range(modes):
                d[i] = here[modes + i]
                force = direct[i] * u + rate[i] * w - stiffness[i] * here[i] - damping[i] * here[modes + i]
                d[modes + i] = force / mass[i] - (gravity if i == 0 else 0.0)
            for j in range(count):
                x = v = 0.0
                for i in range(modes):
                    x += shapes[j, i] * here[i]
                    v += shapes[j, i] * here[modes + i]
                gap, opening = here[2 * modes + j] - x, here[2 * modes + count + j] - v
                push = max(0.0, -k * gap - c[j] * opening) if gap < 0.0 else 0.0
                if gap > clearance[j]:
                    push -= max(0.0, k * (gap - clearance[j]) + c[j] * opening)
                d[2 * modes + j] = here[2 * modes + count + j]
                d[2 * modes + count + j] = push / grains[j] - gravity
                for i in range(modes):
                    d[modes + i] -= shapes[j, i] * push / mass[i]
        for i in range(len(z)):
            z[i] += h / 6.0 * (slopes[0, i] + 2.0 * slopes[1, i] + 2.0 * slopes[2, i] + slopes[3, i])
        t += h
        x = 0.0
        for i in range(modes):
            x += shapes[0, i] * z[i]
        out[step] = x
    return out


def with_contacts(scene: Scene, stiffness: float, damping: Array, step: float, disturbance: float = 0.0) -> Array:
    """Return the first container's displacement at the ends of steps [s] with linear contacts [N/m, N s/m]."""
    s = Structure.of(scene)
    z = s.start()
    n = len(s.mass)
    z[2 * n : 2 * n + len(s.grains)] -= s.grains * s.gravity / stiffness
    s = s._replace(size=s.size * (1.0 + disturbance))
    steps = round(scene.duration / step)
    found: Array = _contacts(*s, stiffness, damping, z, 0.0, step, steps)
    return found
