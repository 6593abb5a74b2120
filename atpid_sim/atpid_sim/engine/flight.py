# SPDX-License-Identifier: Apache-2.0
"""Free flight: beam and grain move exactly until a wall is touched, a force reappears, or the row ends."""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import release_rate, rest_overlap
from atpid_sim.engine.advance import safe_rate_step, safe_step
from atpid_sim.engine.beam import arc_from, bounded_at
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.observe import flight_extreme, flight_samples, flight_work, note_extreme
from atpid_sim.engine.state import (
    BEAM,
    BEAM_RATE,
    FLIGHT_STEPS,
    FREE,
    GRAIN,
    GRAIN_RATE,
    MEMORY,
    MODE,
    OFF_FLOOR,
    ON_CEILING,
    ON_FLOOR,
    spent,
)

#: A gap below this fraction of the motion's size is a touch; it is far above rounding and far below any overlap.
_TOUCH = 1e-14

#: A difference of velocities below this fraction of them is none.
_ROUNDING = 1e-15


@kernel
def fly(y, n, segment, tau, until, system, law, p, observing, sampling, out, budget):  # type: ignore[no-untyped-def]
    """Advance a flight inside one row from local time tau to at most `until`; returns the local time reached.

    Leaves y at that time and n[MODE] at what comes next; a contact that begins afresh is marked by a negative
    y[MEMORY]. `sampling`: (first instant, period, start of the row) [s].
    """
    arc = arc_from(
        system.beam_mass, system.stiffness, system.damping, system.gravity, segment, tau, y[BEAM], y[BEAM_RATE]
    )
    gravity = system.gravity
    grain0, rate0, begin = y[GRAIN], y[GRAIN_RATE], tau
    height, height_rate = segment[10], segment[11]
    slack = 2.0 * system.radius
    fastest = max(arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0, math.sqrt(system.stiffness / system.beam_mass))
    stride = 1.0 / fastest  # a sixth of a period: two turning points never hide in one step
    side = 1.0 if n[MODE] == OFF_FLOOR else -1.0
    flying = n[MODE]
    _x, _v, a, jerk = bounded_at(arc, tau, until)
    x, v = y[BEAM], y[BEAM_RATE]  # as they are: a grain just let go has a rate of exactly zero or away from the wall
    while True:
        s = tau - begin
        grain = grain0 + s * (rate0 - 0.5 * gravity * s)
        rate = rate0 - gravity * s
        lift, lift_rate, lift_acceleration = grain - x, rate - v, -gravity - a
        leaving = height_rate - lift_rate
        rounding = _ROUNDING * (abs(v) + abs(rate) + abs(height_rate))
        if abs(lift_rate) <= rounding:
            lift_rate = 0.0
        if abs(leaving) <= rounding:
            leaving = 0.0
        longest = min(stride, until - tau)
        touch = _TOUCH * (abs(x) + abs(grain) + slack)
        if flying == FREE:
            step = safe_step(lift, lift_rate, lift_acceleration, jerk, longest)
            room = height + height_rate * tau - slack - lift
            above = safe_step(room, leaving, -lift_acceleration, jerk, longest)
            if lift <= touch and (lift_rate < 0.0 or step == 0.0):
                n[MODE] = ON_FLOOR
                grain = x
                y[MEMORY] = -1.0
                break
            if room <= touch and (leaving < 0.0 or above == 0.0):
                n[MODE] = ON_CEILING
                grain = x + height + height_rate * tau - slack
                y[MEMORY] = -1.0
                break
            step = min(step, above)
        else:
            overlap = -lift if side > 0.0 else lift - (height + height_rate * tau - slack)
            closing = -lift_rate if side > 0.0 else lift_rate - height_rate
            acceleration = -side * lift_acceleration
            if overlap <= touch and closing <= 0.0:
                n[MODE] = FREE
                flying = FREE
                continue
            depth = rest_overlap(law, y[MEMORY], p)
            if depth > 0.0:  # a dented wall: no force until the overlap reaches the dent again
                step = safe_step(depth - overlap, -closing, -acceleration, jerk, longest)
                held = step == 0.0 and closing > 0.0
            else:
                limit = release_rate(law, overlap, y[MEMORY], p)
                step = safe_rate_step(limit - closing, acceleration, jerk, longest)
                held = limit <= closing
            # at the very moment of release the force is zero to within rounding: go a hundredth of the way out first
            least = min(1e-2 * overlap / abs(closing) if closing != 0.0 else longest, 1e-6 * stride)
            if tau == begin:
                held = False
            step = max(step, min(least, longest))
            if held:
                n[MODE] = ON_FLOOR if side > 0.0 else ON_CEILING
                break
            step = min(step, safe_step(overlap, closing, acceleration, jerk, longest))
        if tau >= until or spent(n) >= budget:
            break
        n[FLIGHT_STEPS] += 1
        ahead = until if step >= until - tau else tau + step
        if ahead == tau:  # below the clock's resolution: take the surface as reached
            ahead = min(until, tau * (1.0 + 4e-16) + 1e-300)
        x1, v1, a, jerk = bounded_at(arc, ahead, until)
        if observing:
            note_extreme(y, x1)
            if v * v1 < 0.0:
                flight_extreme(y, arc, tau, ahead, v, v1)
        x, v = x1, v1
        tau = ahead
    y[BEAM], y[BEAM_RATE] = x, v
    y[GRAIN], y[GRAIN_RATE] = grain, rate
    if tau > begin:
        flight_work(y, arc, begin, tau)
        flight_samples(n, out, sampling[0], sampling[1], sampling[2], arc, begin, tau, grain0, rate0, gravity, height, height_rate)  # fmt: skip # noqa: E501
    return tau
