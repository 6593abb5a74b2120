# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fidelity `simplified`: beam and grain as one mass (closed damper), or the beam alone (the grain is left out)."""

from atpid_sim.engine import columns as at
from atpid_sim.engine.beam import beam_at, fastest_of
from atpid_sim.engine.modes import free_arc, joined_arc, leave_flight, leave_joined
from atpid_sim.engine.sampling import flight_extreme, flight_samples, joint_samples, record_extreme
from atpid_sim.engine.state import steps_used
from atpid_sim.engine.work import flight_work, joined_work
from atpid_sim.kernel import kernel


@kernel
def one_mass(y, n, segment, tau, until, system, mass, with_grain, control, view, out):
    """Advance one `mass` [kg] from local time tau to `until` in closed form; returns the local time reached.

    Without the grain that stays as it was, touches nothing, and the energy ledger closes.
    """
    if with_grain:
        arc = joined_arc(system.modes, y, mass, system, segment, tau)
    else:
        arc = free_arc(system.modes, y, system.beam_mass, system, segment, tau)
    stride = 1.0 / fastest_of(arc)
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
    if with_grain:
        joined_work(system.modes, y, segment, system, arc, begin, tau)
        leave_joined(system.modes, y, arc, tau)
    else:
        flight_work(system.modes, y, segment, arc, begin, tau)
        leave_flight(system.modes, y, arc, tau)
    x, v, _a, _u, _w = beam_at(arc, tau)
    y[at.BEAM], y[at.BEAM_VELOCITY] = x, v
    if with_grain:
        joint_samples(n, out, view, segment, arc, tau, 1.0, 0.0)
        y[at.GRAIN], y[at.GRAIN_VELOCITY] = x, v
    else:
        flight_samples(n, out, view, segment, arc, begin, tau, y[at.GRAIN], 0.0, 0.0)
    return tau
