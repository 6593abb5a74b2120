# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Flight: beam and grain move in closed form until a wall is touched, a contact force reappears, or the row ends."""

from atpid_sim.contact.dispatch import detachment_velocity, residual_overlap
from atpid_sim.engine import columns as at
from atpid_sim.engine.beam import bounded_at, fastest_of
from atpid_sim.engine.modes import free_arc, leave_flight, stride_pace
from atpid_sim.engine.safe_step import safe_step, safe_velocity_step
from atpid_sim.engine.sampling import flight_extreme, flight_samples, record_extreme
from atpid_sim.engine.state import steps_used
from atpid_sim.engine.work import flight_work
from atpid_sim.kernel import chosen, inlined, kernel

#: A gap below this fraction of the motion's size is a touch; it is far above rounding and far below any overlap.
_TOUCH = 1e-14
#: Jerk of fast free vibrations over all others from which a step past them is worth its search.
_WORTH = 2.0
#: A difference of velocities below this fraction of them is rounding.
_ROUNDING = 1e-15


@inlined
def _free_step(gap, velocity, opening, clearance, acceleration, jerk, longest, touch):
    """Step that surely reaches no wall, and the wall that is touched now: +1 floor, -1 ceiling, 0 none.

    `gap`, `velocity`, `acceleration`: distance from the floor and its derivatives; `clearance`, `opening`: distance
    from the ceiling and its velocity.
    """
    step = safe_step(gap, velocity, acceleration, jerk, longest)
    above = safe_step(clearance, opening, -acceleration, jerk, longest)
    wall = 0
    if gap <= touch and (velocity < 0.0 or step == 0.0):
        wall = 1
    elif clearance <= touch and (opening < 0.0 or above == 0.0):
        wall = -1
    return min(step, above), wall


def _same_step(fast, step, gap, velocity, opening, clearance, acceleration, jerk, longest):
    return step


def _longer_step(fast, step, gap, velocity, opening, clearance, acceleration, jerk, longest):
    floor, ceiling = gap + fast.x - fast.size, clearance - fast.x - fast.size
    slow, others = acceleration + fast.a, jerk - fast.jerk
    if floor <= 0.0 or ceiling <= 0.0 or fast.jerk < _WORTH * others:
        return step
    below = safe_step(floor, velocity + fast.v, slow, others, longest)
    if below <= step:
        return step
    return max(step, min(below, safe_step(ceiling, opening - fast.v, -slow, others, longest)))


#: (fast, step, ...) -> step that surely reaches no wall where fast free vibrations may be anywhere within their size.
_past_fast = chosen(_same_step, _longer_step)


@inlined
def _overlapped_step(law, p, memory, overlap, closing, acceleration, jerk, longest):
    """Step during which an overlapped grain surely feels no force, and whether it feels one now."""
    depth = residual_overlap(law, memory, p)
    if depth > 0.0:  # a dented wall: no force until the overlap reaches the dent again
        step = safe_step(depth - overlap, -closing, -acceleration, jerk, longest)
        return step, step == 0.0 and closing > 0.0
    limit = detachment_velocity(law, overlap, memory, p)
    return safe_velocity_step(limit - closing, acceleration, jerk, longest), limit <= closing


@kernel
def flight(y, n, segment, tau, until, system, law, p, control, view, out):
    """Advance a flight inside one row from local time tau to at most `until`; returns the local time reached.

    Leaves y at that time and n[MODE] at what follows; a contact that begins afresh is marked by a negative y[DEEPEST].
    """
    arc = free_arc(system.modes, y, system.beam_mass, system, segment, tau)
    gravity = system.gravity
    grain0, velocity0, begin = y[at.GRAIN], y[at.GRAIN_VELOCITY], tau
    height, ceiling_velocity = segment[at.HEIGHT], segment[at.CEILING_VELOCITY]
    diameter = 2.0 * system.radius
    radian = 1.0 / fastest_of(arc)
    # a sixth of a period: two turning points are never in one step
    stride = 1.0 / stride_pace(system.modes, arc, view.observing)
    side = 1.0 if n[at.MODE] == at.OFF_FLOOR else -1.0
    flying = n[at.MODE]
    _x, _v, a, jerk, fast = bounded_at(arc, tau, until)
    # unrounded: a grain just detached has a gap velocity of exactly zero or opening
    x, v = y[at.BEAM], y[at.BEAM_VELOCITY]
    while True:
        s = tau - begin
        grain = grain0 + s * (velocity0 - 0.5 * gravity * s)
        velocity = velocity0 - gravity * s
        gap, gap_velocity, gap_acceleration = grain - x, velocity - v, -gravity - a
        opening = ceiling_velocity - gap_velocity
        rounding = _ROUNDING * (abs(v) + abs(velocity) + abs(ceiling_velocity))
        if abs(gap_velocity) <= rounding:
            gap_velocity = 0.0
        if abs(opening) <= rounding:
            opening = 0.0
        longest = min(stride, until - tau)
        touch = _TOUCH * (abs(x) + abs(grain) + diameter)
        if flying == at.FREE:
            clearance = height + ceiling_velocity * tau - diameter - gap
            step, wall = _free_step(gap, gap_velocity, opening, clearance, gap_acceleration, jerk, longest, touch)
            if wall != 0:
                n[at.MODE] = at.ON_FLOOR if wall > 0 else at.ON_CEILING
                grain = x if wall > 0 else x + height + ceiling_velocity * tau - diameter
                y[at.DEEPEST] = -1.0
                break
            if step < 0.5 * longest:
                step = _past_fast(fast, step, gap, gap_velocity, opening, clearance, gap_acceleration, jerk, longest)
        else:
            overlap = -gap if side > 0.0 else gap - (height + ceiling_velocity * tau - diameter)
            closing = -gap_velocity if side > 0.0 else gap_velocity - ceiling_velocity
            acceleration = -side * gap_acceleration
            if overlap <= touch and closing <= 0.0:
                n[at.MODE] = at.FREE
                flying = at.FREE
                continue
            step, held = _overlapped_step(law, p, y[at.DEEPEST], overlap, closing, acceleration, jerk, longest)
            # at the instant of detachment the force is zero to within rounding: first cross a hundredth of the overlap
            least = min(1e-2 * overlap / abs(closing) if closing != 0.0 else longest, 1e-6 * radian)
            if tau == begin:
                held = False
            step = max(step, min(least, longest))
            if held:
                n[at.MODE] = at.ON_FLOOR if side > 0.0 else at.ON_CEILING
                break
            step = min(step, safe_step(overlap, closing, acceleration, jerk, longest))
        if tau >= until or steps_used(n) >= control.budget:
            break
        n[at.FLIGHT_STEPS] += 1
        ahead = until if step >= until - tau else tau + step
        if ahead == tau:  # below the clock's resolution: take the surface as reached
            ahead = min(until, tau * (1.0 + 4e-16) + 1e-300)
        x1, v1, a, jerk, fast = bounded_at(arc, ahead, until)
        if view.observing:
            record_extreme(y, x1)
            if v * v1 < 0.0:
                flight_extreme(y, arc, tau, ahead, v, v1)
        x, v = x1, v1
        tau = ahead
    y[at.BEAM], y[at.BEAM_VELOCITY] = x, v
    y[at.GRAIN], y[at.GRAIN_VELOCITY] = grain, velocity
    leave_flight(system.modes, y, arc, tau)
    if tau > begin:
        flight_work(system.modes, y, segment, arc, begin, tau)
        flight_samples(n, out, view, segment, arc, begin, tau, grain0, velocity0, gravity)
    return tau
