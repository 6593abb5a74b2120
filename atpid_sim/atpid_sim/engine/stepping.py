# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The methods by which a contact is integrated, on a structure of one mode or of several."""

from atpid_sim.engine.dormand_prince import explicit_step
from atpid_sim.engine.modal_implicit import modal_implicit_step
from atpid_sim.engine.modal_step import modal_explicit_step
from atpid_sim.engine.rosenbrock import implicit_step
from atpid_sim.kernel import chosen, inlined

#: Methods: explicit in the fourth root of the time since the contact began, explicit in time, implicit in time.
FOURTH_ROOT, EXPLICIT, IMPLICIT = range(3)


def _one_mode_step(modes, method, segment, model, p, moment, h, motion):
    if method == IMPLICIT:
        return implicit_step(segment, model, p, moment.tau, h, motion)
    return explicit_step(segment, model, p, method == FOURTH_ROOT, moment, h, motion)


def _modal_step(modes, method, segment, model, p, moment, h, motion):
    if method == IMPLICIT:
        return modal_implicit_step(segment, model, p, moment.tau, h, motion)
    return modal_explicit_step(segment, model, p, method == FOURTH_ROOT, moment, h, motion)


#: Chosen when it is compiled: one more call would cost a run of one mode a fifth.
_step = chosen(_one_mode_step, _modal_step)


@inlined
def trial_step(method, segment, model, p, moment, h, motion):
    """One step of size h in the method's own variable; arguments and result as `dormand_prince.explicit_step`."""
    return _step(model.modes, method, segment, model, p, moment, h, motion)
