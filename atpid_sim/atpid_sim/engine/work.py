# SPDX-License-Identifier: Apache-2.0
"""Work of the support and loss of the beam's damper while beam or beam and grain move in closed form."""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import other_arc, support_at
from atpid_sim.engine.beam import beam_at, fastest_of, mode_at
from atpid_sim.engine.modes import from_joined
from atpid_sim.kernel import kernel

# Gauss-Legendre, six points on [0, 1]
NODES = (0.033765242898423986, 0.16939530676686774, 0.3806904069584015,
          0.6193095930415985, 0.8306046932331323, 0.966234757101576)  # fmt: skip
WEIGHTS = (0.08566224618958517, 0.1803807865240693, 0.23395696728634552,
            0.23395696728634552, 0.1803807865240693, 0.08566224618958517)  # fmt: skip

#: Time constants after which a free vibration is negligible: e^-40 of it is below rounding, of its energy far below.
_DECAYED = 40.0


@kernel
def flight_work(modes, y, segment, arc, left, right):
    """Add the support's work and the beam's loss between two local times of a flight."""
    if modes is None:
        _one_mode_work(y, arc, left, right)
    else:
        _modal_work(modes, y, segment, arc, left, right, np.eye(modes.shape[1]), 0.0, 0.0)


@kernel
def joined_work(modes, y, segment, system, arc, left, right):
    """Add both between two local times in which the grain moves with the container."""
    if modes is None:
        _one_mode_work(y, arc, left, right)
    else:
        weight = system.grain_mass * system.gravity
        _modal_work(modes, y, segment, arc, left, right, from_joined(modes), system.grain_mass, weight)


@kernel
def _modal_work(modes, y, segment, arc, left, right, to_free, mass, weight):
    """Add the work of drive and grain on each mode, and its loss, by Gauss-Legendre panels of 1.6 rad.

    to_free (modes, modes): from the arc's coordinates to those in flight; mass [kg], weight [N]: of a grain held.
    """
    if right <= left:
        return
    states = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    count = states.shape[0]
    flows = np.zeros((count, 3))
    velocities = np.empty(count)
    panels = 1 + int(fastest_of(arc) * (right - left) / 1.6)
    length = (right - left) / panels
    for panel in range(panels):
        for node, weighting in zip(NODES, WEIGHTS):  # noqa: B905  numba's zip takes no keyword
            tau = left + length * (panel + node)
            u, w = support_at(segment, tau)
            push = -weight
            for i in range(count):
                if i == 0:
                    _x, velocities[i], a, _u, _w = mode_at(arc, tau)
                else:
                    _x, velocities[i], a, _u, _w = mode_at(other_arc(arc.others[i - 1]), tau)
                push -= mass * a
            for i in range(count):
                v = 0.0
                for k in range(count):
                    v += to_free[i, k] * velocities[k]
                flows[i, 0] += weighting * (modes[at.DIRECT, i] * u + modes[at.RATE, i] * w) * v
                flows[i, 1] += weighting * modes[at.DAMPING, i] * v * v
                flows[i, 2] += weighting * push * v
    for i in range(count):
        y[at.INPUT] += length * flows[i, 0]
        y[at.BEAM_LOSS] += length * flows[i, 1]
        states[i, at.Q_INPUT] += length * flows[i, 0]
        states[i, at.Q_LOSS] += length * flows[i, 1]
        states[i, at.Q_CONTACT] += length * flows[i, 2]


@kernel
def _one_mode_work(y, arc, left, right):
    """Add the support's work and the beam's loss between two local times.

    A free vibration that has decayed needs no fine panels: the cost of a long row depends on its tone, and not on the
    frequency or damping of the beam.
    """
    tone = arc.omega if arc.a0 != 0.0 or arc.a1 != 0.0 else 0.0
    natural = arc.stiffness / arc.mass
    fast, slow = arc.decay, arc.decay
    if arc.squared < 0.0:
        fast = arc.decay + arc.damped
        slow = natural / fast
    soon, fastest = right, max(tone, math.sqrt(natural)) + fast
    if fast * (right - arc.start) > _DECAYED:
        soon = max(left, arc.start + _DECAYED / fast)
        late = min(right, max(left, arc.start + _DECAYED / slow))
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
