# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parts of a mode's motion along an arc: its free vibration, and its answer to a tone close to resonance.

An arc is an `arc.Arc`, or a `modal_arc.ModeArc` of a structure of several modes.
"""

import cmath
import math

from atpid_sim.kernel import inlined, kernel


@kernel
def _second_remainder(z):
    """Return (e^z - 1 - z) / z^2, which does not cancel where z is small."""
    if abs(z.real) + abs(z.imag) > 0.25:
        return (cmath.exp(z) - 1.0 - z) / (z * z)
    real, imag = 1.0, 0.0  # 1 + z/3 (1 + z/4 (1 + ...))
    for n in range(13, 2, -1):
        real, imag = 1.0 + (real * z.real - imag * z.imag) / n, (real * z.imag + imag * z.real) / n
    return 0.5 * complex(real, imag)


@kernel
def grown(arc, s):
    """Amplitude and its rate close to resonance, s seconds after the start: q' = slow q + q0 + q1 s from q = 0."""
    q0, q1 = complex(arc.q0_in, arc.q0_out), complex(arc.q1_in, arc.q1_out)
    slow = complex(-arc.decay, arc.beat)
    q = s * (q0 + s * (slow * q0 + q1) * _second_remainder(slow * s))
    q_rate = slow * q + q0 + q1 * s
    return q.real, q.imag, q_rate.real, q_rate.imag


@kernel
def growing_envelope(arc, q_in, q_out, tau, until, order):
    """Return the same close to resonance: the amplitude grows by no more than the drive adds."""
    s, last = tau - arc.start, until - arc.start
    feed = max(
        math.hypot(arc.q0_in + arc.q1_in * s, arc.q0_out + arc.q1_out * s),
        math.hypot(arc.q0_in + arc.q1_in * last, arc.q0_out + arc.q1_out * last),
    )
    squared = arc.omega * arc.omega
    faster = max(1.0, arc.stiffness / (arc.mass * squared)) ** 2  # where the beam is faster than the tone; order <= 4
    ramp = 0.5 * order * (order - 1.0) * math.hypot(arc.q1_in, arc.q1_out) / squared
    return faster * (math.hypot(q_in, q_out) + (until - tau + order / arc.omega) * feed + ramp)


@kernel
def free_vibration(arc, s):
    """Free vibration and its velocity, s seconds after the start of the arc."""
    angle = arc.damped * s
    if arc.squared > 0.0 and angle > 1e-8:
        fade = math.exp(-arc.decay * s)
        cosine = fade * math.cos(angle)
        sine = fade * math.sin(angle) / arc.damped
    elif arc.squared < 0.0 and angle > 1.0:
        return _overdamped(arc, s)
    elif arc.squared < 0.0 and angle > 1e-8:
        fade = math.exp(-arc.decay * s)
        cosine = fade * math.cosh(angle)
        sine = fade * math.sinh(angle) / arc.damped
    else:
        cosine = math.exp(-arc.decay * s)
        sine = cosine * s
    x = arc.free * cosine + arc.free_velocity * sine
    v = -arc.decay * x - arc.free * arc.squared * sine + arc.free_velocity * cosine
    return x, v


@kernel
def _overdamped(arc, s):
    """The same where overdamped, as two decays: the slow one of a very strong damper keeps its digits."""
    fast = arc.decay + arc.damped
    slow = arc.stiffness / (arc.mass * fast)
    slow_part = 0.5 * (arc.free + arc.free_velocity / arc.damped) * math.exp(-slow * s)
    fast_part = 0.5 * (arc.free - arc.free_velocity / arc.damped) * math.exp(-fast * s)
    return slow_part + fast_part, -slow * slow_part - fast * fast_part


@inlined
def higher(arc, lower, low):
    """The next derivative of the free vibration from the two before it, `lower` the one before `low`."""
    return -(2.0 * arc.decay) * low - arc.stiffness / arc.mass * lower
