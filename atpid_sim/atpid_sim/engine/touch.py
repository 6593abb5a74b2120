# SPDX-License-Identifier: Apache-2.0
"""Contact: beam and grain integrated together by an adaptive Dormand-Prince 5(4) while a force acts between them.

The state is beam displacement and velocity, overlap and overlap rate, so that an overlap of micrometres on a swing of
decimetres keeps its digits. A contact that begins at zero overlap is integrated in s with t = t_c + s^4: the contact
laws' xi^(1/4) is then smooth and the method keeps its order.
"""

from __future__ import annotations

import math

from numba import njit

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.beam import support_at
from atpid_sim.engine.observe import hermite, note_extreme, step_extreme, write_sample
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
    SAMPLE,
    TIME,
    TOUCHING,
)

#: Overlaps are measured to the relative tolerance of at least this share of the beam's swing: an error of an overlap
#: moves the beam by no more than itself, and finer control of the micrometres of a resting grain buys nothing.
_DEPTH_FLOOR = 0.01


@njit(cache=True, inline="always")
def _slope(segment, system, law, p, memory, side, height_rate, tau, x, v, overlap, rate):  # type: ignore[no-untyped-def]
    """Accelerations of beam and overlap, contact force, powers of support and beam damper at one stage."""
    u, w = support_at(segment[2], segment[3], segment[4], segment[5], segment[6], segment[7], segment[8], segment[9], tau)  # fmt: skip # noqa: E501
    slip = v - w
    pull = system.stiffness * (u - x) - system.damping * slip
    push = force(law, overlap, rate, memory, p)
    beam = (pull - side * push) / system.beam_mass - system.gravity
    return (
        beam,
        side * pull / system.beam_mass - push * (1.0 / system.beam_mass + 1.0 / system.grain_mass),
        push,
        pull * w,
        system.damping * slip * slip,
    )


@njit(cache=True)
def _attempt(segment, system, law, p, memory, side, height_rate, origin, smooth, s, h, x, v, overlap, rate, k):  # type: ignore[no-untyped-def]
    """One Dormand-Prince step of size h in the variable s, of local time origin + s^4 if `smooth`, else origin + s.

    `k` holds the accelerations, force and powers at its start. Returns the end state, the same at the end, the error
    estimate of the four states, and the integrals of force times overlap rate, of the two powers and of the force.
    """
    a1, b1, f1, p1, d1 = k
    if smooth:
        s2, s3, s4, s5, s6 = s + 0.2 * h, s + 0.3 * h, s + 0.8 * h, s + 8.0 / 9.0 * h, s + h
        w1, w2, w3 = 4.0 * h * s * s * s, 4.0 * h * s2 * s2 * s2, 4.0 * h * s3 * s3 * s3
        w4, w5, w6 = 4.0 * h * s4 * s4 * s4, 4.0 * h * s5 * s5 * s5, 4.0 * h * s6 * s6 * s6
        t2, t3, t4 = origin + s2 * s2 * s2 * s2, origin + s3 * s3 * s3 * s3, origin + s4 * s4 * s4 * s4
        t5, t6 = origin + s5 * s5 * s5 * s5, origin + s6 * s6 * s6 * s6
    else:
        w1 = w2 = w3 = w4 = w5 = w6 = h
        t2, t3, t4, t5, t6 = (
            origin + s + 0.2 * h, origin + s + 0.3 * h, origin + s + 0.8 * h, origin + s + 8.0 / 9.0 * h, origin + s + h,
        )  # fmt: skip
    # stage slopes already multiplied by the step: x, v, overlap, rate
    kx1, kv1, ko1, kr1 = w1 * v, w1 * a1, w1 * rate, w1 * b1
    v2, r2 = v + 0.2 * kv1, rate + 0.2 * kr1
    a2, b2, _f, _p, _d = _slope(
        segment, system, law, p, memory, side, height_rate, t2, x + 0.2 * kx1, v2, overlap + 0.2 * ko1, r2
    )
    kx2, kv2, ko2, kr2 = w2 * v2, w2 * a2, w2 * r2, w2 * b2
    v3, r3 = v + 3.0 / 40.0 * kv1 + 9.0 / 40.0 * kv2, rate + 3.0 / 40.0 * kr1 + 9.0 / 40.0 * kr2
    a3, b3, f3, p3, d3 = _slope(
        segment, system, law, p, memory, side, height_rate, t3,
        x + 3.0 / 40.0 * kx1 + 9.0 / 40.0 * kx2, v3, overlap + 3.0 / 40.0 * ko1 + 9.0 / 40.0 * ko2, r3,
    )  # fmt: skip
    kx3, kv3, ko3, kr3 = w3 * v3, w3 * a3, w3 * r3, w3 * b3
    v4 = v + 44.0 / 45.0 * kv1 - 56.0 / 15.0 * kv2 + 32.0 / 9.0 * kv3
    r4 = rate + 44.0 / 45.0 * kr1 - 56.0 / 15.0 * kr2 + 32.0 / 9.0 * kr3
    a4, b4, f4, p4, d4 = _slope(
        segment, system, law, p, memory, side, height_rate, t4,
        x + 44.0 / 45.0 * kx1 - 56.0 / 15.0 * kx2 + 32.0 / 9.0 * kx3, v4,
        overlap + 44.0 / 45.0 * ko1 - 56.0 / 15.0 * ko2 + 32.0 / 9.0 * ko3, r4,
    )  # fmt: skip
    kx4, kv4, ko4, kr4 = w4 * v4, w4 * a4, w4 * r4, w4 * b4
    c51, c52, c53, c54 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
    v5 = v + c51 * kv1 + c52 * kv2 + c53 * kv3 + c54 * kv4
    r5 = rate + c51 * kr1 + c52 * kr2 + c53 * kr3 + c54 * kr4
    a5, b5, f5, p5, d5 = _slope(
        segment, system, law, p, memory, side, height_rate, t5,
        x + c51 * kx1 + c52 * kx2 + c53 * kx3 + c54 * kx4, v5,
        overlap + c51 * ko1 + c52 * ko2 + c53 * ko3 + c54 * ko4, r5,
    )  # fmt: skip
    kx5, kv5, ko5, kr5 = w5 * v5, w5 * a5, w5 * r5, w5 * b5
    c61, c62, c63, c64, c65 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0
    v6 = v + c61 * kv1 + c62 * kv2 + c63 * kv3 + c64 * kv4 + c65 * kv5
    r6 = rate + c61 * kr1 + c62 * kr2 + c63 * kr3 + c64 * kr4 + c65 * kr5
    a6, b6, f6, p6, d6 = _slope(
        segment, system, law, p, memory, side, height_rate, t6,
        x + c61 * kx1 + c62 * kx2 + c63 * kx3 + c64 * kx4 + c65 * kx5, v6,
        overlap + c61 * ko1 + c62 * ko2 + c63 * ko3 + c64 * ko4 + c65 * ko5, r6,
    )  # fmt: skip
    kx6, kv6, ko6, kr6 = w6 * v6, w6 * a6, w6 * r6, w6 * b6
    g1, g3, g4, g5, g6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
    x1 = x + g1 * kx1 + g3 * kx3 + g4 * kx4 + g5 * kx5 + g6 * kx6
    v1 = v + g1 * kv1 + g3 * kv3 + g4 * kv4 + g5 * kv5 + g6 * kv6
    o1 = overlap + g1 * ko1 + g3 * ko3 + g4 * ko4 + g5 * ko5 + g6 * ko6
    r1 = rate + g1 * kr1 + g3 * kr3 + g4 * kr4 + g5 * kr5 + g6 * kr6
    last = _slope(segment, system, law, p, memory, side, height_rate, t6, x1, v1, o1, r1)
    e1, e3, e4, e5, e6, e7 = 71.0 / 57600.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -0.025
    errors = (
        e1 * kx1 + e3 * kx3 + e4 * kx4 + e5 * kx5 + e6 * kx6 + e7 * w6 * v1,
        e1 * kv1 + e3 * kv3 + e4 * kv4 + e5 * kv5 + e6 * kv6 + e7 * w6 * last[0],
        e1 * ko1 + e3 * ko3 + e4 * ko4 + e5 * ko5 + e6 * ko6 + e7 * w6 * r1,
        e1 * kr1 + e3 * kr3 + e4 * kr4 + e5 * kr5 + e6 * kr6 + e7 * w6 * last[1],
    )
    absorbed = g1 * w1 * f1 * rate + g3 * w3 * f3 * r3 + g4 * w4 * f4 * r4 + g5 * w5 * f5 * r5 + g6 * w6 * f6 * r6
    work = g1 * w1 * p1 + g3 * w3 * p3 + g4 * w4 * p4 + g5 * w5 * p5 + g6 * w6 * p6
    loss = g1 * w1 * d1 + g3 * w3 * d3 + g4 * w4 * d4 + g5 * w5 * d5 + g6 * w6 * d6
    impulse = g1 * w1 * f1 + g3 * w3 * f3 + g4 * w4 * f4 + g5 * w5 * f5 + g6 * w6 * f6
    return x1, v1, o1, r1, last, errors, (absorbed, work, loss, impulse)


@njit(cache=True)
def _detachment(segment, system, law, p, memory, side, height_rate, origin, smooth, s, h, x, v, overlap, rate, k, end_force):  # type: ignore[no-untyped-def] # noqa: E501
    """Size of the step at whose end the contact force vanishes, given that it changes sign within h (Illinois)."""
    left, right = 0.0, h
    f_left, f_right = k[2], end_force
    if f_left <= 0.0:
        return h
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = _attempt(
            segment, system, law, p, memory, side, height_rate, origin, smooth, s, size, x, v, overlap, rate, k
        )[4][2]
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-9 * h or abs(value) <= 1e-9 * (abs(k[2]) + abs(end_force)):
            break
    return size


@njit(cache=True)
def _turning(segment, system, law, p, memory, side, height_rate, origin, smooth, s, h, x, v, overlap, rate, k, end_rate):  # type: ignore[no-untyped-def] # noqa: E501
    """Size of the step at whose end the overlap rate vanishes: the turning point of a hysteretic contact (Illinois)."""
    left, right = 0.0, h
    f_left, f_right = rate, end_rate
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        value = _attempt(
            segment, system, law, p, memory, side, height_rate, origin, smooth, s, size, x, v, overlap, rate, k
        )[3]
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= 1e-9 * h or abs(value) <= 1e-12 * abs(rate):
            break
    return size


@njit(cache=True)
def resting_overlap(law, p, push):  # type: ignore[no-untyped-def]
    """Overlap [m] at which the elastic force alone reaches `push` [N]: the size against which errors are measured."""
    low, high = 1e-18, 1e3
    for _ in range(60):
        middle = math.sqrt(low * high)
        if force(law, middle, 0.0, middle, p) < push:
            low = middle
        else:
            high = middle
        if high < 1.1 * low:
            break
    return high


@njit(cache=True)
def touch(y, n, segment, tau, until, system, law, hysteretic, p, rtol, scale, observing, sampling, out, budget):  # type: ignore[no-untyped-def]
    """Advance a contact inside one row from local time tau to at most `until`; returns the local time reached.

    Leaves y at that time and n[MODE] at what comes next: still in contact, overlapped without force, or free.
    `scale`: overlap [m] and overlap rate [m/s] below which errors count as absolute.
    """
    side = 1.0 if n[MODE] == ON_FLOOR else -1.0
    height, height_rate = segment[10], segment[11]
    slack = 2.0 * system.radius
    moving = 0.0 if side > 0.0 else height_rate
    x, v = y[BEAM], y[BEAM_RATE]
    lift = y[GRAIN] - x
    overlap = max(0.0, -lift if side > 0.0 else lift - (height + height_rate * tau - slack))
    rate = v - y[GRAIN_RATE] if side > 0.0 else y[GRAIN_RATE] - v - height_rate
    natural = math.sqrt(system.stiffness / system.beam_mass)
    fastest = max(segment[4] if segment[2] != 0.0 or segment[3] != 0.0 else 0.0, natural)
    longest = 0.15 / fastest
    smooth = overlap <= 0.0
    origin, s = (tau, 0.0) if smooth else (0.0, tau)
    h = y[FIRST_STEP] if smooth else 1e-2 * y[FIRST_STEP] ** 4
    if smooth:
        h = min(h, (until - tau) ** 0.25)
    k = _slope(segment, system, law, p, y[MEMORY], side, moving, tau, x, v, overlap, rate)
    deepest, quickest = overlap, abs(rate)
    previous = 1.0
    first = True
    while tau < until:
        end = tau + h
        if smooth:
            end = origin + (s + h) ** 4
            if end - tau > longest:
                h = (tau - origin + longest) ** 0.25 - s
                end = origin + (s + h) ** 4
        elif h > longest:
            h = longest
            end = tau + h
        finishing = end >= until
        if finishing:
            h = (until - origin) ** 0.25 - s if smooth else until - tau
            end = until
        if n[CONTACT_STEPS] + n[REJECTED] > budget:
            break
        x1, v1, o1, r1, k1, errors, sums = _attempt(
            segment, system, law, p, y[MEMORY], side, moving, origin, smooth, s, h, x, v, overlap, rate, k
        )
        swing = abs(x) + abs(v) / natural
        depth = max(abs(o1), overlap, 0.1 * deepest, scale[0], _DEPTH_FLOOR * swing)
        speed = max(abs(r1), abs(rate), 0.1 * quickest, scale[1], natural * swing)
        error = (errors[0] / swing) ** 2 + (errors[1] / (swing * natural)) ** 2 if swing > 0.0 else 0.0
        error += (errors[2] / depth) ** 2 + (errors[3] / speed) ** 2
        error = 0.5 * math.sqrt(error) / rtol
        if not error <= 1.0:
            n[REJECTED] += 1
            if math.isnan(error):
                h *= 0.1
            else:
                h *= max(0.2, 0.9 * error**-0.2)
            if tau + (h if not smooth else (s + h) ** 4 - s**4) == tau and h < 1e-30:
                break
            continue
        leaving = k1[2] <= 0.0
        turning = hysteretic and rate > 0.0 and r1 < 0.0
        size = h
        if turning:
            size = _turning(
                segment, system, law, p, y[MEMORY], side, moving, origin, smooth, s, h, x, v, overlap, rate, k, r1
            )
        elif leaving:
            size = _detachment(
                segment, system, law, p, y[MEMORY], side, moving, origin, smooth, s, h, x, v, overlap, rate, k, k1[2]
            )
        if size < h:
            x1, v1, o1, r1, k1, _errors, sums = _attempt(
                segment, system, law, p, y[MEMORY], side, moving, origin, smooth, s, size, x, v, overlap, rate, k
            )
            end = origin + (s + size) ** 4 if smooth else tau + size
            leaving = leaving and not turning
            if turning:
                r1 = 0.0
        n[CONTACT_STEPS] += 1
        elapsed = end - tau
        if first and smooth:
            y[FIRST_STEP] = h
            first = False
        y[CONTACT_LOSS] += sums[0]
        y[INPUT] += sums[1]
        y[BEAM_LOSS] += sums[2]
        y[CEILING_WORK] -= moving * sums[3]
        if observing:
            y[TOUCHING] += elapsed
            note_extreme(y, x1)
            if v * v1 < 0.0:
                step_extreme(y, elapsed, x, v, k[0], x1, v1, k1[0])
        while n[SAMPLE] < out.shape[1]:
            at = sampling[0] + n[SAMPLE] * sampling[1] - sampling[2]
            if at > end:
                break
            fraction = min(1.0, max(0.0, (at - tau) / elapsed))
            xs = hermite(fraction, elapsed, x, v, k[0], x1, v1, k1[0])
            depth = hermite(fraction, elapsed, overlap, rate, k[1], o1, r1, k1[1])
            ceiling = height + height_rate * at
            u, w = support_at(segment[2], segment[3], segment[4], segment[5], segment[6], segment[7], segment[8], segment[9], at)  # fmt: skip # noqa: E501
            vs = v + fraction * (v1 - v)
            write_sample(out, n[SAMPLE], u, xs, vs, k[0] + fraction * (k1[0] - k[0]),
                         xs - depth if side > 0.0 else xs + ceiling - slack + depth, ceiling)  # fmt: skip
            n[SAMPLE] += 1
        tau, x, v, overlap, rate, k = end, x1, v1, o1, r1, k1
        s += size
        deepest = max(overlap, 0.9 * deepest)
        quickest = max(abs(rate), 0.9 * quickest)
        if hysteretic and overlap > y[MEMORY]:
            y[MEMORY] = overlap
            k = _slope(segment, system, law, p, y[MEMORY], side, moving, tau, x, v, overlap, rate)
        growth = 0.9 * max(error, 1e-6) ** -0.14 * previous**0.08
        previous = max(error, 1e-4)
        h *= min(5.0, max(0.2, growth))
        if smooth and (rate <= 0.0 or turning):
            # from the deepest point on plain time: s^4 would only slow the step control down
            h = 4.0 * s * s * s * h
            smooth, origin, s = False, 0.0, tau
        elif not smooth:
            s = tau
        if leaving:
            n[MODE] = (OFF_FLOOR if side > 0.0 else OFF_CEILING) if overlap > 0.0 else FREE
            break
        if overlap > system.radius or finishing:
            break
    if observing and n[MODE] != ON_FLOOR:
        y[LONGEST] = max(y[LONGEST], sampling[2] + tau - y[BEGUN])
    y[BEAM], y[BEAM_RATE] = x, v
    ceiling = height + height_rate * tau
    if side > 0.0:
        y[GRAIN], y[GRAIN_RATE] = x - overlap, v - rate
    else:
        y[GRAIN], y[GRAIN_RATE] = x + ceiling - slack + overlap, v + rate + height_rate
    return tau
