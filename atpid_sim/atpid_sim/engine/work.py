# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work of the support and loss of the beam's damper while beam or beam and grain move in closed form.

A state whose INPUT is not a number keeps no ledger: a fifth of a run's time at the levels `impact` and `finite`.
"""

import cmath
import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import support_at
from atpid_sim.engine.beam import beam_at, fastest_of
from atpid_sim.engine.modal_arc import mode_arc
from atpid_sim.engine.modal_beam import mode_at
from atpid_sim.engine.modes import from_joined
from atpid_sim.engine.vibration import free_vibration, grown
from atpid_sim.kernel import chosen, inlined, kernel

# Gauss-Legendre, six points on [0, 1]
NODES = (0.033765242898423986, 0.16939530676686774, 0.3806904069584015,
          0.6193095930415985, 0.8306046932331323, 0.966234757101576)  # fmt: skip
WEIGHTS = (0.08566224618958517, 0.1803807865240693, 0.23395696728634552,
            0.23395696728634552, 0.1803807865240693, 0.08566224618958517)  # fmt: skip

#: Longest panel of several modes, in radians of the fastest: six points leave 2e-10 of a square there.
_MODAL_PANEL = 1.6
#: Time constants after which a free vibration is negligible: e^-40 of it is below rounding, of its energy far below.
_DECAYED = 40.0


@kernel
def _enter_flows(y, i, work, loss, contact):
    """Enter the work of the drive on a mode, its loss, and the work of the grain on it [J]."""
    y[at.INPUT] += work
    y[at.BEAM_LOSS] += loss
    states = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    states[i, at.Q_INPUT] += work
    states[i, at.Q_LOSS] += loss
    states[i, at.Q_CONTACT] += contact


@kernel
def _free_mode_work(modes, i, y, arc, left, right, segment):
    """Add the work of the drive on one mode in flight, and its loss."""
    if math.isnan(y[at.INPUT]):
        return
    mode = mode_arc(arc.modes, i)
    tone = arc.omega if arc.tone else 0.0
    natural = mode.stiffness / mode.mass
    soon, late, fastest, slow = _stretches(mode, natural, tone, left, right)
    for begin, end, pace in ((left, soon, fastest), (soon, late, tone + slow), (late, right, tone)):
        if end <= begin:
            continue
        panels = 1 + int(pace * (end - begin) / _MODAL_PANEL)
        length = (end - begin) / panels
        swings = mode.squared > 0.0 and not mode.resonant
        work = loss = 0.0
        for node, weight in zip(NODES, WEIGHTS):  # noqa: B905  numba's zip takes no keyword
            tau = begin + length * node
            # from panel to panel, tone and free vibration only turn by the same angle
            tone_turn = free_turn = tone_at = free_at = complex(1.0, 0.0)
            if arc.tone:
                tone_at = cmath.exp(complex(0.0, arc.omega * tau + arc.phase))
            if swings:
                free_at = cmath.exp(complex(-mode.decay, mode.damped) * (tau - mode.start))
            if panels > 1:
                tone_turn = cmath.exp(complex(0.0, tone * length))
                free_turn = cmath.exp(complex(-mode.decay, mode.damped) * length)
            for _panel in range(panels):
                u, w, v = _driven_velocity(mode, segment, tau, tone_at)
                if swings:
                    sine = free_at.imag / mode.damped
                    y1 = mode.free_velocity * (free_at.real - mode.decay * sine)
                    y1 -= mode.free * (mode.decay * free_at.real + mode.squared * sine)
                else:
                    y1 = free_vibration(mode, tau - mode.start)[1]
                v += y1
                work += weight * (modes[at.DIRECT, i] * u + modes[at.RATE, i] * w) * v
                loss += weight * v * v
                tau += length
                tone_at, free_at = tone_at * tone_turn, free_at * free_turn
        _enter_flows(y, i, length * work, length * modes[at.DAMPING, i] * loss, 0.0)


@inlined
def _driven_velocity(mode, segment, tau, turn):
    """The drive's signal, its rate, and the velocity with which a mode answers; turn: of the tone, complex."""
    u = segment[at.C0] + tau * (segment[at.C1] + tau * (segment[at.C2] + tau * segment[at.C3]))
    w = segment[at.C1] + tau * (2.0 * segment[at.C2] + tau * 3.0 * segment[at.C3])
    amplitude = segment[at.A0] + segment[at.A1] * tau
    u += amplitude * turn.imag
    w += segment[at.A1] * turn.imag + segment[at.OMEGA] * amplitude * turn.real
    v = mode.p1 + tau * (2.0 * mode.p2 + tau * 3.0 * mode.p3)
    if mode.resonant:
        q_in, q_out, rate_in, rate_out = grown(mode, tau - mode.start)
    else:
        rate_in, rate_out = mode.q1_in, mode.q1_out
        q_in, q_out = mode.q0_in + tau * rate_in, mode.q0_out + tau * rate_out
    v += (rate_in - mode.omega * q_out) * turn.imag + (rate_out + mode.omega * q_in) * turn.real
    return u, w, v


@kernel
def _joined_modes_work(modes, y, segment, system, arc, left, right):
    """Add the work of drive and grain on each mode, and its loss, while the grain is held."""
    if right <= left or math.isnan(y[at.INPUT]):
        return
    count, to_free = modes.shape[1], from_joined(modes)
    flows, velocities = np.zeros((count, 3)), np.empty(count)
    panels = 1 + int(fastest_of(arc) * (right - left) / _MODAL_PANEL)
    length = (right - left) / panels
    for panel in range(panels):
        for node, weight in zip(NODES, WEIGHTS):  # noqa: B905  numba's zip takes no keyword
            tau = left + length * (panel + node)
            u, w = support_at(segment, tau)
            for i in range(count):
                velocities[i] = mode_at(mode_arc(arc.modes, i), arc.phase, tau)[1]
            push = -system.grain_mass * (beam_at(arc, tau)[2] + system.gravity)
            for i in range(count):
                v = 0.0
                for k in range(count):
                    v += to_free[i, k] * velocities[k]
                flows[i, 0] += weight * (modes[at.DIRECT, i] * u + modes[at.RATE, i] * w) * v
                flows[i, 1] += weight * v * v
                flows[i, 2] += weight * push * v
    for i in range(count):
        _enter_flows(y, i, length * flows[i, 0], length * modes[at.DAMPING, i] * flows[i, 1], length * flows[i, 2])


@kernel
def _stretches(arc, natural, tone, left, right):
    """Local times until which a free vibration is fast, and until which it is slow, and the paces of both [rad/s].

    One that has decayed needs no fine panels: the cost of a long row depends on its tone, and not on the frequency or
    damping of a mode.
    """
    fast, slow = arc.decay, arc.decay
    if arc.squared < 0.0:
        fast = arc.decay + arc.damped
        slow = natural / fast
    soon = late = right
    if fast * (right - arc.start) > _DECAYED:
        soon = max(left, arc.start + _DECAYED / fast)
        late = min(right, max(left, arc.start + _DECAYED / slow))
    return soon, late, max(tone, math.sqrt(natural)) + fast, slow


@kernel
def _one_mode_work(y, arc, left, right):
    """Add the support's work and the beam's loss between two local times."""
    if math.isnan(y[at.INPUT]):
        return
    tone = arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0
    soon, late, fastest, slow = _stretches(arc, arc.stiffness / arc.mass, tone, left, right)
    _add_work(y, arc, soon, late, tone + slow)
    _add_work(y, arc, late, right, tone)
    _add_work(y, arc, left, soon, fastest)


@kernel
def _add_work(y, arc, left, right, pace):
    """Add both by Gauss-Legendre panels of 1.6 rad of `pace` [rad/s]."""
    if right <= left:
        return
    panels = 1 + int(pace * (right - left) / 1.6)
    length = (right - left) / panels
    work = loss = 0.0
    for panel in range(panels):
        for node, weight in zip(NODES, WEIGHTS):  # noqa: B905  numba's zip takes no keyword
            x, v, _a, u, w = beam_at(arc, left + length * (panel + node))
            slip = v - w
            work += weight * (arc.stiffness * (u - x) - arc.damping * slip) * w
            loss += weight * arc.damping * slip * slip
    y[at.INPUT] += length * work
    y[at.BEAM_LOSS] += length * loss


def _one_in_flight(modes, y, segment, arc, left, right):
    _one_mode_work(y, arc, left, right)


def _several_in_flight(modes, y, segment, arc, left, right):
    for i in range(modes.shape[1]):
        _free_mode_work(modes, i, y, arc, left, right, segment)


def _one_joined(modes, y, segment, system, arc, left, right):
    _one_mode_work(y, arc, left, right)


def _several_joined(modes, y, segment, system, arc, left, right):
    _joined_modes_work(modes, y, segment, system, arc, left, right)


#: (modes, y, segment, arc, left, right): add the work of the drive and the loss between two local times of a flight.
flight_work = chosen(_one_in_flight, _several_in_flight)
#: (modes, y, segment, system, arc, left, right): the same while the grain moves with the container.
joined_work = chosen(_one_joined, _several_joined)
