# SPDX-License-Identifier: Apache-2.0
"""The `simplified` rung: beam and grain as one mass (closed damper), or the beam alone (no ceiling in reach)."""

from __future__ import annotations

import math

from atpid_sim.engine.beam import arc_from, beam_at
from atpid_sim.engine.drive import END, HEIGHT, HEIGHT_RATE, START
from atpid_sim.engine.kernel import kernel
from atpid_sim.engine.observe import flight_extreme, flight_work, note_extreme, write_sample
from atpid_sim.engine.state import BEAM, BEAM_RATE, FLIGHT_STEPS, FREE, GRAIN, GRAIN_RATE, MODE, SAMPLE, TIME

DONE, STEP_BUDGET, NOT_FINITE = range(3)  # as in `outcome.py`


@kernel
def run_one_mass(table, system, mass, y, n, observe, sampling, out, budget):  # type: ignore[no-untyped-def]
    """Carry one `mass` [kg] through the drive table (rows, 12) in closed form; arguments and result as `soft.run`.

    The beam's mass alone leaves the grain out: it stays as it was, touches nothing, and the energy ledger closes.
    """
    alone = mass == system.beam_mass
    if alone:
        n[MODE] = FREE
    for row in range(table.shape[0]):
        segment = table[row]
        start, end = segment[START], segment[END]
        if end <= y[TIME]:
            continue
        observing = observe[0] <= 0.5 * (start + end) <= observe[1]
        tau, until = y[TIME] - start, end - start
        arc = arc_from(mass, system.stiffness, system.damping, system.gravity, segment, tau, y[BEAM], y[BEAM_RATE])
        x, v, _a, _u, _w = beam_at(arc, tau)
        stride = 1.0 / max(
            math.sqrt(system.stiffness / mass), segment[4] if segment[2] != 0.0 or segment[3] != 0.0 else 0.0
        )
        flight_work(y, arc, tau, until)
        if observing:
            note_extreme(y, x)
            while tau < until:
                if n[FLIGHT_STEPS] >= budget:
                    return STEP_BUDGET
                n[FLIGHT_STEPS] += 1
                ahead = min(until, tau + stride)
                x1, v1, _a, _u, _w = beam_at(arc, ahead)
                note_extreme(y, x1)
                if v * v1 < 0.0:
                    flight_extreme(y, arc, tau, ahead, v, v1)
                tau, v = ahead, v1
        while n[SAMPLE] < out.shape[1]:
            at = sampling[0] + n[SAMPLE] * sampling[1] - start
            if at > until:
                break
            xs, vs, acceleration, u, _w = beam_at(arc, at)
            grain, ceiling = y[GRAIN] if alone else xs, segment[HEIGHT] + segment[HEIGHT_RATE] * at
            write_sample(out, n[SAMPLE], u, xs, vs, acceleration, grain, ceiling)
            n[SAMPLE] += 1
        x, v, _a, _u, _w = beam_at(arc, until)
        if not (math.isfinite(x) and math.isfinite(v)):
            return NOT_FINITE
        y[BEAM], y[BEAM_RATE], y[TIME] = x, v, end
        if not alone:
            y[GRAIN], y[GRAIN_RATE] = x, v
    return DONE
