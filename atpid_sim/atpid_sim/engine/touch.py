# SPDX-License-Identifier: Apache-2.0
"""Contact: beam and grain integrated together while a force acts between them.

A contact that begins at zero overlap is integrated in s with t = t_c + s^4: the contact laws' xi^(1/4) is then smooth
and the method keeps its order. From the deepest point on it goes on in plain time, and where the grain comes to rest,
so that stability and no longer accuracy sets the explicit step, with the implicit one.
"""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import energy, release_rate
from atpid_sim.engine.beam import support_at
from atpid_sim.engine.drive import A0, A1, C0, C1, C2, C3, HEIGHT, HEIGHT_RATE, OMEGA, PHASE
from atpid_sim.engine.kernel import inlined, kernel
from atpid_sim.engine.observe import contact_samples, next_sample, note_extreme, step_extreme
from atpid_sim.engine.release import detachment, turning_point
from atpid_sim.engine.rest import contact_pace
from atpid_sim.engine.state import (
    BEAM,
    BEAM_LOSS,
    BEAM_RATE,
    BEGUN,
    CEILING_WORK,
    CONTACT_LOSS,
    CONTACT_STEPS,
    FIRST_STEP,
    FREE,
    GRAIN,
    GRAIN_RATE,
    INPUT,
    LONGEST,
    MEMORY,
    MODE,
    OFF_CEILING,
    OFF_FLOOR,
    ON_FLOOR,
    REJECTED,
    TOUCHING,
    spent,
)
from atpid_sim.engine.step import Moment, Motion, Touch, slope, support_ahead
from atpid_sim.engine.trial import PLAIN, RESTING, SMOOTH, trial

#: Overlaps are measured to the relative tolerance of at least this share of the beam's swing: an error of an overlap
#: moves the beam by no more than itself, and finer control of the micrometres of a resting grain buys nothing.
DEPTH_FLOOR = 0.01

#: Steps times the contact's pace from which stability holds the explicit method back.
_STIFF = 2.0

#: Steps of one uninterrupted contact before which that is not looked at: a short rest costs less with explicit steps.
_SETTLED = 100

#: Steps of one uninterrupted contact after which the ringing of a grain at rest counts by its displacement alone.
_PATIENCE = 3000

#: Steps after which only the beam is still computed to the tolerance: elastic ringing without end is damped out.
_ENDURANCE = 60_000


@kernel
def _touching(y, n, system, law, hysteretic):  # type: ignore[no-untyped-def]
    """Collect what stays the same during a contact."""
    side = 1.0 if n[MODE] == ON_FLOOR else -1.0
    inverse = 1.0 / system.beam_mass
    return Touch(
        law, hysteretic, y[MEMORY], side, system.stiffness, system.damping, system.gravity, inverse,
        inverse + 1.0 / system.grain_mass,
    )  # fmt: skip


@kernel
def _remember(touching, memory):  # type: ignore[no-untyped-def]
    """Return the same contact with a deeper overlap to remember."""
    return Touch(
        touching.law, touching.hysteretic, memory, touching.side, touching.stiffness, touching.damping,
        touching.gravity, touching.beam_inverse, touching.reduced_inverse,
    )  # fmt: skip


@kernel
def _first(y, touching, p, segment, slack, moment):  # type: ignore[no-untyped-def]
    """Motion with which the contact is taken up."""
    x, v = y[BEAM], y[BEAM_RATE]
    lift, rate = y[GRAIN] - x, y[GRAIN_RATE] - v
    if touching.side > 0.0:
        overlap, rate = -lift, -rate
    else:
        overlap, rate = (
            lift - (segment[HEIGHT] + segment[HEIGHT_RATE] * moment.tau - slack),
            rate - segment[HEIGHT_RATE],
        )
    overlap = max(0.0, overlap)
    u, w = support_ahead(segment, moment.tau, 0.0, moment.sine, moment.cosine)
    return Motion(x, v, overlap, rate, slope(touching, p, u, w, x, v, overlap, rate))


@kernel
def _put_back(y, touching, segment, slack, tau, motion):  # type: ignore[no-untyped-def]
    """Enter the motion at local time tau into the state."""
    y[BEAM], y[BEAM_RATE] = motion.x, motion.v
    if touching.side > 0.0:
        y[GRAIN], y[GRAIN_RATE] = motion.x - motion.overlap, motion.v - motion.rate
    else:
        y[GRAIN] = motion.x + segment[HEIGHT] + segment[HEIGHT_RATE] * tau - slack + motion.overlap
        y[GRAIN_RATE] = motion.v + motion.rate + segment[HEIGHT_RATE]


@kernel
def _support(segment, tau):  # type: ignore[no-untyped-def]
    """Support displacement [m]."""
    return support_at(segment[A0], segment[A1], segment[OMEGA], segment[PHASE], segment[C0], segment[C1], segment[C2], segment[C3], tau)[0]  # fmt: skip # noqa: E501


@inlined
def _moment(segment, tau, s):  # type: ignore[no-untyped-def]
    """Where the next step begins."""
    angle = segment[OMEGA] * tau + segment[PHASE]
    return Moment(tau, s, math.sin(angle), math.cos(angle))


@inlined
def _fitted(way, h, tau, origin, s, until, longest):  # type: ignore[no-untyped-def]
    """Step in the method's own variable, its end in local time, and whether it reaches `until`."""
    if way == SMOOTH:
        end = origin + (s + h) ** 4
        if end - tau > longest:
            h = (tau - origin + longest) ** 0.25 - s
            end = origin + (s + h) ** 4
        if end >= until:
            return (until - origin) ** 0.25 - s, until, True
        return h, end, False
    h = min(h, longest)
    return (until - tau, until, True) if tau + h >= until else (h, tau + h, False)


@inlined
def _weighed(touching, p, begin, end, errors, deepest, quickest, natural, rest, scale, rtol, taken):  # type: ignore[no-untyped-def]
    """Error of a step over the one allowed; overlap and beam each count in their own size."""
    swing = abs(begin.x - rest) + abs(begin.v) / natural + scale[2]
    # errors as large as a resting grain's overlap would let go of it and catch it again without end
    depth = max(abs(end.overlap), begin.overlap, 0.1 * deepest, scale[0], min(DEPTH_FLOOR * swing, scale[0] / rtol))
    speed = max(abs(end.rate), abs(begin.rate), 0.1 * quickest, scale[1], min(natural * swing, scale[1] / rtol))
    if taken > _PATIENCE:
        depth = math.inf if taken > _ENDURANCE else depth
        speed = max(speed, contact_pace(touching, p, begin.overlap, begin.rate)[1] * depth)
    inner = (errors[2] / depth) ** 2 + (errors[3] / speed) ** 2
    outer = errors[0] ** 2 + (errors[1] / natural) ** 2
    return max(0.5 * math.sqrt(inner + outer / (swing * swing)) / rtol, 1e-6)


@kernel
def _repeated(way, h, error, missed):  # type: ignore[no-untyped-def]
    """Size with which a rejected step is tried again."""
    if missed:
        return 0.5 * h
    if math.isnan(error):
        return 0.1 * h
    return h * max(0.2, 0.9 * error ** (-0.25 if way == RESTING else -0.2))


@inlined
def _next(way, h, logarithm, previous):  # type: ignore[no-untyped-def]
    """Size of the step after one whose error had this logarithm, and the one before it that of `previous`."""
    if way == RESTING:
        return h * min(6.0, max(0.2, 0.9 * math.exp(-0.25 * logarithm)))
    return h * min(5.0, max(0.2, 0.9 * math.exp(0.08 * previous - 0.14 * logarithm)))


@kernel
def _book(y, touching, p, moving, overlap, overlap1, sums):  # type: ignore[no-untyped-def]
    """Enter one step into the energy ledger."""
    lost = sums[0]
    if touching.hysteretic:
        law, memory = touching.law, touching.memory
        lost += energy(law, overlap, memory, p) - energy(law, overlap1, max(overlap1, memory), p)
    y[CONTACT_LOSS] += max(0.0, lost)  # a law only takes; the quadrature's negative weights may say otherwise
    y[INPUT] += sums[1]
    y[BEAM_LOSS] += sums[2]
    y[CEILING_WORK] -= moving * sums[3]


@kernel
def _watch(y, elapsed, begin, end):  # type: ignore[no-untyped-def]
    """Note what one step adds to the observation window."""
    y[TOUCHING] += elapsed
    note_extreme(y, end.x)
    if begin.v * end.v < 0.0:
        step_extreme(y, elapsed, begin.x, begin.v, begin.slope[0], end.x, end.v, end.slope[0])


@kernel
def _let_go(y, n, touching, p, motion, least):  # type: ignore[no-untyped-def]
    """End a contact whose force has vanished and set the mode; returns the motion with what overlap is left."""
    law, memory, overlap, rate = touching.law, y[MEMORY], motion.overlap, motion.rate
    y[CONTACT_LOSS] += energy(law, max(overlap, 0.0), memory, p)  # still compressed, but nothing holds it
    undamped = not touching.hysteretic and release_rate(law, overlap, memory, p) == -math.inf
    if undamped or overlap < 1e-6 * max(least, memory):
        overlap = 0.0  # with no damping to speak of the force vanishes only where the surfaces part
        rate = min(rate, 0.0)  # they do part: a rate that rounding left closing would find the same contact again
    if overlap > 0.0:
        n[MODE] = OFF_FLOOR if touching.side > 0.0 else OFF_CEILING
    else:
        n[MODE] = FREE
    return Motion(motion.x, motion.v, overlap, rate, motion.slope)


@kernel
def touch(y, n, segment, tau, until, system, law, hysteretic, p, rtol, scale, observing, sampling, out, budget):  # type: ignore[no-untyped-def]
    """Advance a contact inside one row from local time tau to at most `until`; returns the local time reached.

    Leaves y at that time and n[MODE] at what comes next: still in contact, overlapped without force, or free.
    `scale`: overlap [m], overlap rate [m/s] and swing [m] below which errors count as absolute.
    """
    touching = _touching(y, n, system, law, hysteretic)
    slack = 2.0 * system.radius
    moving = 0.0 if touching.side > 0.0 else segment[HEIGHT_RATE]
    natural = math.sqrt(system.stiffness / system.beam_mass)
    fastest = max(segment[OMEGA] if segment[A0] != 0.0 or segment[A1] != 0.0 else 0.0, natural)
    rest = -(system.beam_mass + system.grain_mass) * system.gravity / system.stiffness
    motion = _first(y, touching, p, segment, slack, _moment(segment, tau, 0.0))
    way, origin, s, h = SMOOTH, tau, 0.0, min(y[FIRST_STEP], (until - tau) ** 0.25)
    if motion.overlap > 0.0:
        # a force near zero for long: the noise of explicit steps would let go again and again
        way = RESTING if n[CONTACT_STEPS] > _ENDURANCE else PLAIN
        origin, s, h = 0.0, tau, 1e-2 * y[FIRST_STEP] ** 4
    moment = _moment(segment, tau, s)
    start = _support(segment, tau)
    deepest, quickest = motion.overlap, abs(motion.rate)
    previous = 0.0
    taken = 0
    due = next_sample(n, out, sampling)
    while tau < until and spent(n) < budget:
        h, end_time, finishing = _fitted(way, h, tau, origin, s, until, (0.3 if way == RESTING else 0.15) / fastest)
        end, errors, sums = trial(way, segment, touching, p, moment, h, motion)
        error = _weighed(touching, p, motion, end, errors, deepest, quickest, natural, rest, scale, rtol, taken)
        leaving = end.slope[2] <= 0.0
        # a whole contact inside the first step: it must be seen, unless it is too faint to matter
        missed = leaving and taken == 0 and way == SMOOTH and motion.rate * (end_time - tau) > 1e-3 * scale[0]
        if missed or not error <= 1.0:
            n[REJECTED] += 1
            h = _repeated(way, h, error, missed)
            if h < 1e-25 and math.isnan(error):
                y[BEAM] = math.nan  # no step is short enough: the force itself is not a number
                return tau
            continue
        # the kink of a hysteretic law: below the deepest overlap the rate may change its sign without one
        turning = hysteretic and motion.rate > 0.0 and end.rate < 0.0 and motion.overlap >= touching.memory
        size = h
        if turning:
            size = turning_point(way, segment, touching, p, moment, h, motion, end.rate)
        elif leaving:
            size = detachment(way, segment, touching, p, moment, h, motion, end.slope[2])
        if size < h:
            end, errors, sums = trial(way, segment, touching, p, moment, size, motion)
            end_time = origin + (s + size) ** 4 if way == SMOOTH else tau + size
            leaving = leaving and not turning
            finishing = False
            if turning:
                end = Motion(end.x, end.v, end.overlap, 0.0, end.slope)
        n[CONTACT_STEPS] += 1
        elapsed = end_time - tau
        if taken == 0 and way == SMOOTH:
            y[FIRST_STEP] = h
        taken += 1
        _book(y, touching, p, moving, motion.overlap, end.overlap, sums)
        if observing:
            _watch(y, elapsed, motion, end)
        if due <= end_time:
            due = contact_samples(n, out, sampling, segment, touching.side, slack, tau, elapsed, motion, end)
        tau, motion = end_time, end
        s += size
        deepest = max(motion.overlap, 0.9 * deepest)
        quickest = max(abs(motion.rate), 0.9 * quickest)
        if motion.overlap > y[MEMORY]:
            y[MEMORY] = motion.overlap
            if hysteretic:
                touching = _remember(touching, motion.overlap)
        if leaving:
            motion = _let_go(y, n, touching, p, motion, scale[0])
            break
        if motion.overlap > system.radius or finishing:
            break
        logarithm = math.log(error)
        h = _next(way, h, logarithm, previous)
        previous = max(logarithm, -9.0)
        if way == SMOOTH and (motion.rate <= 0.0 or turning):
            # from the deepest point on plain time: s^4 would only slow the step control down
            h = 4.0 * s * s * s * h
            way, origin = PLAIN, 0.0
        if way != RESTING and taken > _SETTLED and taken % 8 == 0:
            held_back = elapsed * contact_pace(touching, p, motion.overlap, motion.rate)[0] > _STIFF
            if held_back or taken > _PATIENCE:
                way, h = RESTING, elapsed
        moment = _moment(segment, tau, s if way == SMOOTH else tau)
        s = moment.s
    y[INPUT] += 0.5 * system.stiffness * (_support(segment, tau) ** 2 - start**2)
    if observing and n[MODE] != ON_FLOOR:
        y[LONGEST] = max(y[LONGEST], sampling[2] + tau - y[BEGUN])
    _put_back(y, touching, segment, slack, tau, motion)
    return tau
