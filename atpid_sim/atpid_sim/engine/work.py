# SPDX-License-Identifier: Apache-2.0
"""Work of the support and loss of the beam's damper while beam or beam and grain move in closed form."""

import math

from atpid_sim.engine.beam import beam_at
from atpid_sim.engine.columns import BEAM_LOSS, INPUT
from atpid_sim.kernel import kernel

# Gauss-Legendre, six points on [0, 1]
_NODES = (0.033765242898423986, 0.16939530676686774, 0.3806904069584015,
          0.6193095930415985, 0.8306046932331323, 0.966234757101576)  # fmt: skip
_WEIGHTS = (0.08566224618958517, 0.1803807865240693, 0.23395696728634552,
            0.23395696728634552, 0.1803807865240693, 0.08566224618958517)  # fmt: skip

#: Time constants after which a free vibration is negligible: e^-40 of it is below rounding, of its energy far below.
_DECAYED = 40.0


@kernel
def flight_work(y, arc, left, right):
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
        for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905  numba's zip takes no keyword
            x, v, _a, u, w = beam_at(arc, left + length * (panel + node))
            slip = v - w
            work += weight * (arc.stiffness * (u - x) - arc.damping * slip) * w
            loss += weight * arc.damping * slip * slip
    y[INPUT] += length * work
    y[BEAM_LOSS] += length * loss
