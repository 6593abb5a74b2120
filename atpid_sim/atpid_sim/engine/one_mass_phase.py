# SPDX-License-Identifier: Apache-2.0
"""Fidelity `simplified`: beam and grain as one mass (closed damper), or the beam alone (the grain is left out)."""

import math

from atpid_sim.engine import columns as at
from atpid_sim.engine.beam import arc_from, beam_at
from atpid_sim.engine.sampling import flight_extreme, flight_samples, joint_samples, record_extreme
from atpid_sim.engine.state import steps_used
from atpid_sim.engine.work import flight_work
from atpid_sim.kernel import kernel


@kernel
def one_mass(y, n, segment, tau, until, system, mass, with_grain, control, view, out):
    """Advance one `mass` [kg] from local time tau to `until` in closed form; returns the local time reached.

    Without the grain that stays as it was, touches nothing, and the energy ledger closes.
    """
    arc = arc_from(mass, system, segment, tau, y[at.BEAM], y[at.BEAM_VELOCITY])
    tone = segment[at.OMEGA] if segment[at.A0] != 0.0 or segment[at.A1] != 0.0 else 0.0
    stride = 1.0 / max(math.sqrt(system.stiffness / mass), tone)
    begin = tau
    x, v, _a, _u, _w = beam_at(arc, tau)
    if view.observing:
        record_extreme(y, x)
        while tau < until and steps_used(n) < control.budget:
            n[at.FLIGHT_STEPS] += 1
            ahead = min(until, tau + stride)
            x1, v1, _a, _u, _w = beam_at(arc, ahead)
            record_extreme(y, x1)
            if v * v1 < 0.0:
                flight_extreme(y, arc, tau, ahead, v, v1)
            tau, v = ahead, v1
    else:
        tau = until
    flight_work(y, arc, begin, tau)
    x, v, _a, _u, _w = beam_at(arc, tau)
    y[at.BEAM], y[at.BEAM_VELOCITY] = x, v
    if with_grain:
        joint_samples(n, out, view, segment, arc, tau, 1.0, 0.0)
        y[at.GRAIN], y[at.GRAIN_VELOCITY] = x, v
    else:
        flight_samples(n, out, view, segment, arc, begin, tau, y[at.GRAIN], 0.0, 0.0)
    return tau
