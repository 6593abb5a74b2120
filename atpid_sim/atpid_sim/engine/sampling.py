# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a run records: the range of the beam in the observation window, and the sample series."""

import math
from typing import NamedTuple

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import support_at
from atpid_sim.engine.beam import beam_at
from atpid_sim.engine.hermite import cubic, hermite, hermite_velocity
from atpid_sim.kernel import kernel


class SampleView(NamedTuple):
    """What is recorded within one row: whether it lies in the observation window, and when samples are due [s]."""

    observing: bool
    first: float  # instant of the first sample
    period: float
    origin: float  # start of the row


@kernel
def record_extreme(y, x):
    """Widen the observed range of the beam to contain x [m]."""
    if x < y[at.LOWEST]:
        y[at.LOWEST] = x
    if x > y[at.HIGHEST]:
        y[at.HIGHEST] = x


@kernel
def flight_extreme(y, arc, left, right, v_left, v_right):
    """Record the beam's turning point between two local times where its velocity changed sign."""
    s = left - v_left * (right - left) / (v_right - v_left)
    for _ in range(4):
        _x, v, a, _u, _w = beam_at(arc, s)
        if a == 0.0:
            break
        step = -v / a
        s = min(max(s + step, left), right)
        if abs(step) <= 1e-6 * (right - left):
            break
    record_extreme(y, beam_at(arc, s)[0])


@kernel
def step_extreme(y, h, x0, v0, a0, x1, v1, a1):
    """Record the turning point inside one contact step whose end velocities differ in sign."""
    left, right = 0.0, 1.0
    s = v0 / (v0 - v1)
    for _ in range(30):
        velocity = hermite_velocity(s, h, x0, v0, a0, x1, v1, a1)
        if velocity * v0 > 0.0:
            left = s
        else:
            right = s
        if right - left < 1e-5:
            break
        s = 0.5 * (left + right)
    record_extreme(y, hermite(s, h, x0, v0, a0, x1, v1, a1))


@kernel
def _write_sample(n, out, support, x, v, a, grain, ceiling):
    """Fill the next column of the sample series."""
    i = n[at.SAMPLE]
    out[at.S_SUPPORT, i] = support
    out[at.S_BEAM, i] = x
    out[at.S_VELOCITY, i] = v
    out[at.S_ACCELERATION, i] = a
    out[at.S_GRAIN, i] = grain
    out[at.S_CEILING, i] = ceiling
    n[at.SAMPLE] = i + 1


@kernel
def next_sample(n, out, view):
    """Local time of the next sample [s]; infinity where there is none."""
    return view.first + n[at.SAMPLE] * view.period - view.origin if n[at.SAMPLE] < out.shape[1] else math.inf


@kernel
def flight_samples(n, out, view, segment, arc, left, right, grain, velocity, gravity):
    """Write the samples of the flight (left, right] in local time; `grain`, `velocity` of the grain at `left`."""
    tau = next_sample(n, out, view)
    while tau <= right:
        x, v, a, _u, _w = beam_at(arc, tau)
        u = support_at(segment, tau)[0]
        s = tau - left
        ceiling = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau
        _write_sample(n, out, u, x, v, a, grain + s * (velocity - 0.5 * gravity * s), ceiling)
        tau = next_sample(n, out, view)


@kernel
def joint_samples(n, out, view, segment, arc, right, side, diameter):
    """Write the samples up to local time `right` of beam and grain that move as one mass.

    `side`: +1 grain on the floor, -1 at the ceiling.
    """
    tau = next_sample(n, out, view)
    while tau <= right:
        x, v, a, _u, _w = beam_at(arc, tau)
        ceiling = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau
        _write_sample(
            n, out, support_at(segment, tau)[0], x, v, a, x if side > 0.0 else x + ceiling - diameter, ceiling
        )
        tau = next_sample(n, out, view)


@kernel
def contact_samples(n, out, view, segment, side, diameter, tau, elapsed, begin, end):
    """Write all samples in a contact step of `elapsed` [s] from local time tau on; returns the time of the next.

    `begin`, `end`: the motion (`dormand_prince.Motion`) at the ends of the step.
    """
    x, v, overlap, velocity, a = begin.x, begin.v, begin.overlap, begin.velocity, begin.rates.beam_acceleration
    x1, v1, overlap1, velocity1, a1 = end.x, end.v, end.overlap, end.velocity, end.rates.beam_acceleration
    due = next_sample(n, out, view)
    while due <= tau + elapsed:
        s = min(1.0, max(0.0, (due - tau) / elapsed))
        xs, vs = hermite(s, elapsed, x, v, a, x1, v1, a1), hermite_velocity(s, elapsed, x, v, a, x1, v1, a1)
        depth = cubic(s, elapsed, overlap, velocity, overlap1, velocity1)
        ceiling = segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * due
        grain = xs - depth if side > 0.0 else xs + ceiling - diameter + depth
        _write_sample(n, out, support_at(segment, due)[0], xs, vs, a + s * (a1 - a), grain, ceiling)
        due = next_sample(n, out, view)
    return due
