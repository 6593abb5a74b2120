# SPDX-License-Identifier: Apache-2.0
"""One trial step of a contact, by whichever way it is being stepped."""

from __future__ import annotations

from atpid_sim.engine.kernel import inlined
from atpid_sim.engine.rest import implicit_step
from atpid_sim.engine.step import explicit_step

#: Ways to step: from the touch on in the fourth root of time, in plain time, implicitly.
SMOOTH, PLAIN, RESTING = range(3)


@inlined
def trial(way, segment, touching, p, moment, h, motion):  # type: ignore[no-untyped-def]
    """One step of size h in the way's own variable; arguments and result as `step.explicit_step`."""
    if way == RESTING:
        return implicit_step(segment, touching, p, moment.tau, h, motion)
    return explicit_step(segment, touching, p, way == SMOOTH, moment, h, motion)
