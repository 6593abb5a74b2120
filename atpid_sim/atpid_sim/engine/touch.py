# SPDX-License-Identifier: Apache-2.0
"""Contact: beam and grain integrated together while a force acts between them.

A contact that begins at zero overlap is integrated in s with t = t_c + s^4: the contact laws' xi^(1/4) is then smooth
and the method keeps its order. From the deepest point on it goes on in plain time, and where the grain comes to rest,
so that stability and no longer accuracy sets the explicit step, with the implicit one.
"""

from __future__ import annotations

import math

from atpid_sim.contact.dispatch import energy, release_rate
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.observe import contact_samples, next_sample, note_extreme, step_extreme
from atpid_sim.engine.release import detachment, turning_point
from atpid_sim.engine.rest import contact_pace, implicit_step
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
)
from atpid_sim.engine.step import Touch, explicit_step, slope, support_ahead

#: Overlaps are measured to the relative tolerance of at least this share of the beam's swing: an error of an overlap
#: moves the beam by no more than itself, and finer control of the micrometres of a resting grain buys nothing.
_DEPTH_FLOOR = 0.01

#: Ways to step: from the touch on in the fourth root of time, in plain time, implicitly.
_SMOOTH, _PLAIN, _RESTING = range(3)

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
def _fitted(way, h, tau, origin, s, until, longest):  # type: ignore[no-untyped-def]
    """Step in the method's own variable, its end in local time, and whether it reaches `until`."""
    if way == _SMOOTH:
        end = origin + (s + h) ** 4
        if end - tau > longest:
            h = (tau - origin + longest) ** 0.25 - s
            end = origin + (s + h) ** 4
        if end >= until:
            return (until - origin) ** 0.25 - s, until, True
        return h, end, False
    h = min(h, longest)
    return (until - tau, until, True) if tau + h >= until else (h, tau + h, False)


@kernel
def _weighed(errors, depth, speed, swing, natural, rtol):  # type: ignore[no-untyped-def]
    """Error of a step over the one allowed; overlap and beam each count in their own size."""
    inner = (errors[2] / depth) ** 2 + (errors[3] / speed) ** 2
    outer = errors[0] ** 2 + (errors[1] / natural) ** 2
    return max(0.5 * math.sqrt(inner + outer / (swing * swing)) / rtol, 1e-6)


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
def _let_go(y, n, touching, p, overlap, least):  # type: ignore[no-untyped-def]
    """End a contact whose force has vanished; returns the overlap that is left and sets the mode."""
    law, memory = touching.law, y[MEMORY]
    y[CONTACT_LOSS] += energy(law, max(overlap, 0.0), memory, p)  # still compressed, but nothing holds it
    undamped = not touching.hysteretic and release_rate(law, overlap, memory, p) == -math.inf
    if undamped or overlap < 1e-6 * max(least, memory):
        overlap = 0.0  # with no damping to speak of the force vanishes only where the surfaces part
    if overlap > 0.0:
        n[MODE] = OFF_FLOOR if touching.side > 0.0 else OFF_CEILING
    else:
        n[MODE] = FREE
    return overlap


@kernel
def touch(y, n, segment, tau, until, system, law, hysteretic, p, rtol, scale, observing, sampling, out, budget):  # type: ignore[no-untyped-def]
    """Advance a contact inside one row from local time tau to at most `until`; returns the local time reached.

    Leaves y at that time and n[MODE] at what comes next: still in contact, overlapped without force, or free.
    `scale`: overlap [m], overlap rate [m/s] and swing [m] below which errors count as absolute.
    """
    touching = _touching(y, n, system, law, hysteretic)
    side = touching.side
    height, height_rate = segment[10], segment[11]
    slack = 2.0 * system.radius
    moving = 0.0 if side > 0.0 else height_rate
    x, v = y[BEAM], y[BEAM_RATE]
    lift = y[GRAIN] - x
    overlap = max(0.0, -lift if side > 0.0 else lift - (height + height_rate * tau - slack))
    rate = v - y[GRAIN_RATE] if side > 0.0 else y[GRAIN_RATE] - v - height_rate
    natural = math.sqrt(system.stiffness / system.beam_mass)
    fastest = max(segment[4] if segment[2] != 0.0 or segment[3] != 0.0 else 0.0, natural)
    way = _SMOOTH if overlap <= 0.0 else _PLAIN
    if way == _PLAIN and n[CONTACT_STEPS] > _ENDURANCE:
        way = _RESTING  # a force near zero for long: the noise of explicit steps would let go again and again
    origin, s = (tau, 0.0) if way == _SMOOTH else (0.0, tau)
    h = min(y[FIRST_STEP], (until - tau) ** 0.25) if way == _SMOOTH else 1e-2 * y[FIRST_STEP] ** 4
    sine, cosine = math.sin(segment[4] * tau + segment[5]), math.cos(segment[4] * tau + segment[5])
    u, w = support_ahead(segment, tau, 0.0, sine, cosine)
    k = slope(touching, p, u, w, x, v, overlap, rate)
    deepest, quickest = overlap, abs(rate)
    rest = -(system.beam_mass + system.grain_mass) * system.gravity / system.stiffness
    previous = 0.0
    taken = 0
    due = next_sample(n, out, sampling)
    while tau < until:
        h, end, finishing = _fitted(way, h, tau, origin, s, until, (0.3 if way == _RESTING else 0.15) / fastest)
        if n[CONTACT_STEPS] + n[REJECTED] > budget:
            break
        if way == _RESTING:
            x1, v1, o1, r1, k1, errors, sums = implicit_step(segment, touching, p, tau, h, x, v, overlap, rate, k)
        else:
            x1, v1, o1, r1, k1, errors, sums = explicit_step(
                segment, touching, p, tau, sine, cosine, way == _SMOOTH, s, h, x, v, overlap, rate, k
            )
        swing = abs(x - rest) + abs(v) / natural + scale[2]
        # errors as large as a resting grain's overlap would let go of it and catch it again without end
        depth = max(abs(o1), overlap, 0.1 * deepest, scale[0], min(_DEPTH_FLOOR * swing, scale[0] / rtol))
        speed = max(abs(r1), abs(rate), 0.1 * quickest, scale[1], min(natural * swing, scale[1] / rtol))
        if taken > _PATIENCE:
            depth = math.inf if taken > _ENDURANCE else depth
            speed = max(speed, contact_pace(touching, p, overlap, rate)[1] * depth)
        error = _weighed(errors, depth, speed, swing, natural, rtol)
        leaving = k1[2] <= 0.0
        # a whole contact inside the first step: it must be seen, unless it is too faint to matter
        missed = leaving and taken == 0 and way == _SMOOTH and rate * (end - tau) > 1e-3 * scale[0]
        if missed or not error <= 1.0:
            n[REJECTED] += 1
            if missed:
                h *= 0.5
            elif math.isnan(error):
                h *= 0.1
                if h < 1e-25:
                    x = math.nan  # no step is short enough: the force itself is not a number
                    break
            else:
                h *= max(0.2, 0.9 * error ** (-0.25 if way == _RESTING else -0.2))
            continue
        # the kink of a hysteretic law: below the deepest overlap the rate may change its sign without one
        turning = hysteretic and rate > 0.0 and r1 < 0.0 and overlap >= touching.memory
        size = h
        if turning:
            size = turning_point(
                way == _RESTING,
                segment,
                touching,
                p,
                tau,
                sine,
                cosine,
                way == _SMOOTH,
                s,
                h,
                x,
                v,
                overlap,
                rate,
                k,
                r1,
            )
        elif leaving:
            size = detachment(
                way == _RESTING,
                segment,
                touching,
                p,
                tau,
                sine,
                cosine,
                way == _SMOOTH,
                s,
                h,
                x,
                v,
                overlap,
                rate,
                k,
                k1[2],
            )
        if size < h:
            if way == _RESTING:
                x1, v1, o1, r1, k1, errors, sums = implicit_step(
                    segment, touching, p, tau, size, x, v, overlap, rate, k
                )
            else:
                x1, v1, o1, r1, k1, errors, sums = explicit_step(
                    segment, touching, p, tau, sine, cosine, way == _SMOOTH, s, size, x, v, overlap, rate, k
                )
            end = origin + (s + size) ** 4 if way == _SMOOTH else tau + size
            leaving = leaving and not turning
            finishing = False
            if turning:
                r1 = 0.0
        n[CONTACT_STEPS] += 1
        elapsed = end - tau
        if taken == 0 and way == _SMOOTH:
            y[FIRST_STEP] = h
        taken += 1
        _book(y, touching, p, moving, overlap, o1, sums)
        if observing:
            y[TOUCHING] += elapsed
            note_extreme(y, x1)
            if v * v1 < 0.0:
                step_extreme(y, elapsed, x, v, k[0], x1, v1, k1[0])
        if due <= end:
            due = contact_samples(
                n, out, sampling, segment, side, slack, tau, elapsed, x, v, overlap, rate, k[0], x1, v1, o1, r1, k1[0]
            )
        tau, x, v, overlap, rate, k = end, x1, v1, o1, r1, k1
        s += size
        deepest = max(overlap, 0.9 * deepest)
        quickest = max(abs(rate), 0.9 * quickest)
        if overlap > y[MEMORY]:
            y[MEMORY] = overlap
            if hysteretic:
                touching = _remember(touching, overlap)
        if leaving:
            overlap = _let_go(y, n, touching, p, overlap, scale[0])
            break
        if overlap > system.radius or finishing:
            break
        logarithm = math.log(error)
        if way == _RESTING:
            h *= min(6.0, max(0.2, 0.9 * math.exp(-0.25 * logarithm)))
        else:
            sine, cosine = math.sin(segment[4] * tau + segment[5]), math.cos(segment[4] * tau + segment[5])
            h *= min(5.0, max(0.2, 0.9 * math.exp(0.08 * previous - 0.14 * logarithm)))
        previous = max(logarithm, -9.0)
        if way == _SMOOTH and (rate <= 0.0 or turning):
            # from the deepest point on plain time: s^4 would only slow the step control down
            h = 4.0 * s * s * s * h
            way, origin = _PLAIN, 0.0
        if way != _RESTING and taken > _SETTLED and taken % 8 == 0:
            held_back = elapsed * contact_pace(touching, p, overlap, rate)[0] > _STIFF
            if held_back or taken > _PATIENCE:
                way, h = _RESTING, elapsed
        if way != _SMOOTH:
            s = tau
    if observing and n[MODE] != ON_FLOOR:
        y[LONGEST] = max(y[LONGEST], sampling[2] + tau - y[BEGUN])
    y[BEAM], y[BEAM_RATE] = x, v
    if side > 0.0:
        y[GRAIN], y[GRAIN_RATE] = x - overlap, v - rate
    else:
        y[GRAIN], y[GRAIN_RATE] = x + height + height_rate * tau - slack + overlap, v + rate + height_rate
    return tau
