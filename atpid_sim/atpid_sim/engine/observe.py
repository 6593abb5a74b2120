# SPDX-License-Identifier: Apache-2.0
"""What is read off the motion while it is computed: extremes, samples, and the work done in free flight."""

from __future__ import annotations

import math

from atpid_sim.engine.beam import beam_at, support_at
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.state import (
    BEAM_LOSS,
    HIGHEST,
    INPUT,
    LOWEST,
    S_ACCELERATION,
    S_BEAM,
    S_CEILING,
    S_GRAIN,
    S_RATE,
    S_SUPPORT,
    SAMPLE,
)

# Gauss-Legendre, six points on [0, 1]
_NODES = (0.033765242898423986, 0.16939530676686774, 0.3806904069584015,
          0.6193095930415985, 0.8306046932331323, 0.966234757101576)  # fmt: skip
_WEIGHTS = (0.08566224618958517, 0.1803807865240693, 0.23395696728634552,
            0.23395696728634552, 0.1803807865240693, 0.08566224618958517)  # fmt: skip

#: A swing is over after this many of its time constants: e^-40 of it is below rounding, of its energy far below.
_DECAYED = 40.0


@kernel
def note_extreme(y, x):  # type: ignore[no-untyped-def]
    """Widen the observed range of the beam to contain x [m]."""
    if x < y[LOWEST]:
        y[LOWEST] = x
    if x > y[HIGHEST]:
        y[HIGHEST] = x


@kernel
def flight_extreme(y, arc, left, right, v_left, v_right):  # type: ignore[no-untyped-def]
    """Note the beam's turning point between two local times where its velocity changed sign."""
    s = left - v_left * (right - left) / (v_right - v_left)
    for _ in range(4):
        _x, v, a, _u, _w = beam_at(arc, s)
        if a == 0.0:
            break
        step = -v / a
        s = min(max(s + step, left), right)
        if abs(step) <= 1e-6 * (right - left):
            break
    note_extreme(y, beam_at(arc, s)[0])


@kernel
def hermite(s, h, x0, v0, a0, x1, v1, a1):  # type: ignore[no-untyped-def]
    """Quintic through position, velocity and acceleration at both ends of a step h, at the fraction s in [0, 1]."""
    p0, q0 = h * v0, 0.5 * h * h * a0
    p1, q1 = h * v1, 0.5 * h * h * a1
    d = x1 - x0
    c3 = 10.0 * d - 6.0 * p0 - 4.0 * p1 - 3.0 * q0 + q1
    c4 = -15.0 * d + 8.0 * p0 + 7.0 * p1 + 3.0 * q0 - 2.0 * q1
    c5 = 6.0 * d - 3.0 * (p0 + p1) - q0 + q1
    return x0 + s * (p0 + s * (q0 + s * (c3 + s * (c4 + s * c5))))


@kernel
def hermite_rate(s, h, x0, v0, a0, x1, v1, a1):  # type: ignore[no-untyped-def]
    """Rate of the same quintic."""
    p0, q0 = h * v0, 0.5 * h * h * a0
    p1, q1 = h * v1, 0.5 * h * h * a1
    d = x1 - x0
    c3 = 10.0 * d - 6.0 * p0 - 4.0 * p1 - 3.0 * q0 + q1
    c4 = -15.0 * d + 8.0 * p0 + 7.0 * p1 + 3.0 * q0 - 2.0 * q1
    c5 = 6.0 * d - 3.0 * (p0 + p1) - q0 + q1
    return (p0 + s * (2.0 * q0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h


@kernel
def cubic(s, h, x0, v0, x1, v1):  # type: ignore[no-untyped-def]
    """Cubic through position and velocity at both ends of a step h, at the fraction s.

    For overlaps: their accelerations are small differences of large forces.
    """
    d = x1 - x0 - h * v0
    e = h * (v1 - v0) - 2.0 * d
    return x0 + s * (h * v0 + s * (d - e + s * e))


@kernel
def step_extreme(y, h, x0, v0, a0, x1, v1, a1):  # type: ignore[no-untyped-def]
    """Note the turning point inside one contact step whose end velocities differ in sign."""
    left, right = 0.0, 1.0
    s = v0 / (v0 - v1)
    for _ in range(30):
        rate = hermite_rate(s, h, x0, v0, a0, x1, v1, a1)
        if rate * v0 > 0.0:
            left = s
        else:
            right = s
        if right - left < 1e-5:
            break
        s = 0.5 * (left + right)
    note_extreme(y, hermite(s, h, x0, v0, a0, x1, v1, a1))


@kernel
def write_sample(out, i, support, x, v, a, grain, ceiling):  # type: ignore[no-untyped-def]
    """Fill column i of the sample series."""
    out[S_SUPPORT, i] = support
    out[S_BEAM, i] = x
    out[S_RATE, i] = v
    out[S_ACCELERATION, i] = a
    out[S_GRAIN, i] = grain
    out[S_CEILING, i] = ceiling


@kernel
def flight_samples(n, out, first, period, origin, arc, left, right, grain, rate, gravity, height, height_rate):  # type: ignore[no-untyped-def]
    """Write the samples of the flight (left, right], in local time of the row that began at `origin`."""
    while n[SAMPLE] < out.shape[1]:
        tau = first + n[SAMPLE] * period - origin
        if tau > right:
            break
        x, v, a, u, _w = beam_at(arc, tau)
        s = tau - left
        write_sample(out, n[SAMPLE], u, x, v, a, grain + s * (rate - 0.5 * gravity * s), height + height_rate * tau)
        n[SAMPLE] += 1


@kernel
def flight_work(y, arc, left, right):  # type: ignore[no-untyped-def]
    """Add the support's work and the beam's loss between two local times.

    What has decayed needs no fine panels: a long row costs by its tone, and not by the beam's frequency or damping.
    """
    tone = arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0
    natural = arc.stiffness / arc.mass
    quick, slow = arc.decay, arc.decay
    if arc.squared < 0.0:
        quick = arc.decay + arc.rate
        slow = natural / quick
    soon, fastest = right, max(tone, math.sqrt(natural)) + quick
    if quick * (right - arc.start) > _DECAYED:
        soon = max(left, arc.start + _DECAYED / quick)
        late = min(right, max(left, arc.start + _DECAYED / slow))
        _add_work(y, arc, soon, late, tone + slow)
        _add_work(y, arc, late, right, tone)
    _add_work(y, arc, left, soon, fastest)


@kernel
def _add_work(y, arc, left, right, pace):  # type: ignore[no-untyped-def]
    """Add the same by Gauss-Legendre panels of 1.6 rad of `pace` [rad/s]."""
    if right <= left:
        return
    panels = 1 + int(pace * (right - left) / 1.6)
    length = (right - left) / panels
    work = loss = 0.0
    for panel in range(panels):
        for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905  numba's zip takes no keyword
            x, v, _a, u, w = beam_at(arc, left + length * (panel + node))
            slip = v - w
            work += weight * (arc.stiffness * (u - x) - arc.damping * slip) * w
            loss += weight * arc.damping * slip * slip
    y[INPUT] += length * work
    y[BEAM_LOSS] += length * loss


@kernel
def next_sample(n, out, sampling):  # type: ignore[no-untyped-def]
    """Local time of the next sample [s]; infinity where there is none."""
    return sampling[0] + n[SAMPLE] * sampling[1] - sampling[2] if n[SAMPLE] < out.shape[1] else math.inf


@kernel
def contact_samples(n, out, sampling, segment, side, slack, tau, elapsed, begin, end):  # type: ignore[no-untyped-def]
    """Write all samples whose instants lie in a contact step of `elapsed` [s] from local time tau on; returns the next.

    `begin`, `end`: the motion (`step.Motion`) at the step's ends.
    """
    x, v, overlap, rate, a = begin.x, begin.v, begin.overlap, begin.rate, begin.slope[0]
    x1, v1, overlap1, rate1, a1 = end.x, end.v, end.overlap, end.rate, end.slope[0]
    at = next_sample(n, out, sampling)
    while at <= tau + elapsed:
        s = min(1.0, max(0.0, (at - tau) / elapsed))
        xs, vs = hermite(s, elapsed, x, v, a, x1, v1, a1), hermite_rate(s, elapsed, x, v, a, x1, v1, a1)
        depth = cubic(s, elapsed, overlap, rate, overlap1, rate1)
        ceiling = segment[10] + segment[11] * at
        support = support_at(
            segment[2], segment[3], segment[4], segment[5], segment[6], segment[7], segment[8], segment[9], at
        )[0]
        grain = xs - depth if side > 0.0 else xs + ceiling - slack + depth
        write_sample(out, n[SAMPLE], support, xs, vs, a + s * (a1 - a), grain, ceiling)
        n[SAMPLE] += 1
        at = next_sample(n, out, sampling)
    return at
