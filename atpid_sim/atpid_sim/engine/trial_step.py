# SPDX-License-Identifier: Apache-2.0
"""One trial step of a contact by the method in use."""

from __future__ import annotations

from atpid_sim.engine.dormand_prince import explicit_step
from atpid_sim.engine.rosenbrock import implicit_step
from atpid_sim.kernel import inlined

#: Explicit in the fourth root of the time since the contact began, explicit in time, implicit in time.
FOURTH_ROOT, EXPLICIT, IMPLICIT = range(3)


@inlined
def trial_step(method, segment, model, p, moment, h, motion):  # type: ignore[no-untyped-def]
    """One step of size h in the method's own variable; arguments and result as `dormand_prince.explicit_step`."""
    if method == IMPLICIT:
        return implicit_step(segment, model, p, moment.tau, h, motion)
    return explicit_step(segment, model, p, method == FOURTH_ROOT, moment, h, motion)
