# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ball in a rectangular container on a beam's tip, in the plane, by impulses: rigid walls, Coulomb friction, rolling.

Shares nothing with the engine of `atpid_sim`. The tip is displaced by y along the motion, y - u of it by the beam's
deflection w, which turns the container by s w and draws the tip inwards by 0.4 s w^2, as in a cantilever with a load at
its tip (s = 1.5 over the length). The container's mass and inertia are those of y alone; a contact acts on y through
the derivative of the touched point, so that energy is conserved.

Moreau's time stepping (Nonsmooth Mechanics and Applications, CISM 302, 1988): half a step of all positions, impulses of
all walls that are touched there, half a step again. An impulse reverses the normal velocity by the restitution and
brings the tangential one to rest, or reaches the friction coefficient times the normal one. First order in the step.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from atpid_sim.kernel import kernel

#: Sweeps over the walls touched at once, in a corner.
_SWEEPS = 30
#: Inward motion of the tip over s w^2: the shortening of a cantilever bent by a load at its tip [-].
_INWARD = 0.4


class Planar(NamedTuple):
    """A system, plain numbers in SI units."""

    beam: float  # mass of beam and container [kg]
    ball: float  # mass [kg]
    stiffness: float  # [N/m]
    damping: float  # [N s/m]
    amplitude: float  # of the support [m]
    omega: float  # of the support [rad/s]
    gravity: float  # against the motion's direction [m/s^2]
    side_gravity: float  # towards the side wall [m/s^2]
    clearance: float  # between floor and ceiling, height less the diameter [m]
    side_clearance: float  # to either side, half the width less the radius [m]
    radius: float  # [m]
    restitution: float  # at all walls [-]
    friction: float  # Coulomb's coefficient at all walls [-]
    slope: float  # of the container over the deflection [rad/m]
    inertia: float = 0.4  # of the ball over m r^2 [-]; very large: it does not turn


class Seen(NamedTuple):
    """What a run shows in its window."""

    amplitude: float  # of the beam, half peak to peak [m]
    regular: bool  # whether it repeats every period or two, within 2 %
    side_impacts: float  # faster than a hundredth of omega times the amplitude of the support's closed damper, a period


#: Places in the state: tip, ball sideways and along the motion, ball's angular velocity (counter-clockwise).
TIP, SIDE, ALONG, TIP_V, SIDE_V, ALONG_V, SPIN, LOSS = range(8)


def steady(p: Planar, mass: float) -> complex:
    """Return the phasor of the displacement [m] of one mass [kg] on the beam, the support being Im(A exp(i w t))."""
    resistance = complex(p.stiffness - mass * p.omega**2, p.damping * p.omega)
    return complex(p.stiffness, p.damping * p.omega) * p.amplitude / resistance


def at_rest(p: Planar) -> Any:
    """Return the state (8,) of the closed damper's steady motion at t = 0, the ball on floor and side wall."""
    both = p.beam + p.ball
    closed, sag = steady(p, both), both * p.gravity / p.stiffness
    y, v = closed.imag - sag, p.omega * closed.real
    return np.array([y, -p.side_clearance, y, v, 0.0, v, 0.0, 0.0])


@kernel
def _gaps(p: Any, w: float, tip: float, side: float, along: float) -> Any:
    """Return the gaps (4,) of floor, ceiling, left and right wall, the angle, and the ball in the container's axes."""
    angle = p.slope * w
    c, s = math.cos(angle), math.sin(angle)
    dz, dy = side + _INWARD * p.slope * w * w, along - tip
    across, up = c * dz + s * dy, c * dy - s * dz
    return (up, p.clearance - up, p.side_clearance + across, p.side_clearance - across), angle, across, up


@kernel
def advance(p: Any, state: Any, start: float, step: float, count: int, tips: Any) -> int:
    """Advance the state by so many steps [s], write the tip after each (count,) [m]; return the impacts on the sides.

    The impacts are those faster than 1 % of the closing speed of the tip's own velocity; state[LOSS] is increased by
    the energy that contacts absorb [J].
    """
    y, bz, by, yv, bzv, byv, spin, loss = state
    k = p.inertia * p.ball * p.radius * p.radius
    normals = ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))
    jn, jt = np.zeros(4), np.zeros(4)
    before = np.zeros(4)
    geometry = np.zeros((4, 6))
    sides = 0
    for n in range(count):
        t = start + (n + 0.5) * step
        u, uv = p.amplitude * math.sin(p.omega * t), p.amplitude * p.omega * math.cos(p.omega * t)
        y, bz, by = y + 0.5 * step * yv, bz + 0.5 * step * bzv, by + 0.5 * step * byv
        w = y - u
        gaps, angle, across, up = _gaps(p, w, y, bz, by)
        force = -p.stiffness * w - p.damping * (yv - uv) - p.beam * p.gravity
        yf = yv + step * force / p.beam
        zf, bf = bzv - step * p.side_gravity, byv - step * p.gravity
        if min(gaps) >= 0.0:
            yv, bzv, byv = yf, zf, bf
        else:
            c, s = math.cos(angle), math.sin(angle)
            for i in range(4):
                jn[i] = jt[i] = 0.0
                if gaps[i] >= 0.0:
                    continue
                n0, n1 = normals[i]
                # the touched point in the container's axes from the tip, at the ball's centre less the radius
                pz, py = (
                    (across, -p.radius if i == 0 else p.clearance + p.radius)
                    if i < 2
                    else (-n0 * (p.side_clearance + p.radius), up)
                )
                jz = -2.0 * _INWARD * p.slope * w - p.slope * (s * pz + c * py)
                jy = 1.0 + p.slope * (c * pz - s * py)
                nz, ny = c * n0 - s * n1, s * n0 + c * n1
                tz, ty = ny, -nz
                geometry[i] = (nz, ny, tz, ty, jz * nz + jy * ny, jz * tz + jy * ty)
                g = geometry[i]
                before[i] = nz * bzv + ny * byv - g[4] * (yv - uv) - ny * uv
            z0, b0, y0, s0 = zf, bf, yf, spin
            for _ in range(_SWEEPS):
                change = 0.0
                for i in range(4):
                    if gaps[i] >= 0.0:
                        continue
                    g = geometry[i]
                    un = g[0] * zf + g[1] * bf - g[4] * (yf - uv) - g[1] * uv
                    aim = max(
                        jn[i] - (un + p.restitution * min(before[i], 0.0)) / (1.0 / p.ball + g[4] ** 2 / p.beam), 0.0
                    )
                    dn = aim - jn[i]
                    jn[i] = aim
                    zf, bf, yf = zf + dn * g[0] / p.ball, bf + dn * g[1] / p.ball, yf - dn * g[4] / p.beam
                    ut = g[2] * zf + g[3] * bf + p.radius * spin - g[5] * (yf - uv) - g[3] * uv
                    most = p.friction * jn[i]
                    aim = jt[i] - ut / (1.0 / p.ball + p.radius * p.radius / k + g[5] ** 2 / p.beam)
                    aim = min(max(aim, -most), most)
                    dt = aim - jt[i]
                    jt[i] = aim
                    zf, bf, yf = zf + dt * g[2] / p.ball, bf + dt * g[3] / p.ball, yf - dt * g[5] / p.beam
                    spin += dt * p.radius / k
                    change = max(change, abs(dn) + abs(dt))
                if change <= 1e-12 * p.ball * p.omega * p.radius:
                    break
            # the work of impulses: impulse times the mean of the velocities before and after
            loss -= 0.5 * p.ball * ((zf - z0) * (zf + z0) + (bf - b0) * (bf + b0))
            loss -= 0.5 * p.beam * (yf - y0) * (yf + y0) + 0.5 * k * (spin - s0) * (spin + s0)
            for i in range(2, 4):
                sides += gaps[i] < 0.0 and jn[i] > 0.0 and before[i] < -0.01 * abs(p.omega * p.clearance)
            yv, bzv, byv = yf, zf, bf
        y, bz, by = y + 0.5 * step * yv, bz + 0.5 * step * bzv, by + 0.5 * step * byv
        tips[n] = y
    state[:] = (y, bz, by, yv, bzv, byv, spin, loss)
    return sides


def seen(p: Planar, settle: int, steps: int = 4000, window: int = 30, start: Any = None) -> Seen:
    """Return what is seen in so many periods after so many others, with so many steps a period."""
    state = at_rest(p) if start is None else np.array(start)
    step = 2.0 * math.pi / p.omega / steps
    advance(p, state, 0.0, step, settle * steps, np.empty(settle * steps))
    tips = np.empty(window * steps)
    sides = advance(p, state, 0.0, step, window * steps, tips)
    size = 0.5 * float(np.ptp(tips))
    rows = tips.reshape(window, steps)[:, ::50]
    change = float(np.abs(rows[2:] - rows[:-2]).max())
    return Seen(size, change <= 0.02 * size, sides / window)
