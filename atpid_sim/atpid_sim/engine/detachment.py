# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The methods by which a contact is integrated; where inside a step its force vanishes, or a hysteretic one turns."""

import math

from atpid_sim.contact.dispatch import force
from atpid_sim.engine.dormand_prince import explicit_step
from atpid_sim.engine.modal_implicit import modal_implicit_step
from atpid_sim.engine.modal_step import modal_explicit_step
from atpid_sim.engine.rosenbrock import implicit_step
from atpid_sim.kernel import chosen, inlined, kernel

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


@kernel
def vanishing(method, segment, model, p, moment, h, motion, end, turning):
    """Size of the step at whose end the contact force vanishes or, `turning`, the overlap velocity: regula falsi.

    Given that it changes sign within h, from `motion` to `end` (Illinois).
    """
    left, right = 0.0, h
    f_left, f_right = motion.rates.force, end.rates.force
    narrow, small = 1e-6 * h, 1e-6 * (abs(f_left) + abs(f_right))
    if turning:
        f_left, f_right = motion.velocity, end.velocity
        narrow, small = 1e-9 * h, 1e-12 * abs(f_left)
    if f_left <= 0.0:
        return h
    size = h
    for _ in range(30):
        size = right - f_right * (right - left) / (f_right - f_left)
        reached = trial_step(method, segment, model, p, moment, size, motion)[0]
        value = reached.velocity if turning else reached.rates.force
        if value > 0.0:
            left, f_left = size, value
            f_right *= 0.5
        else:
            right, f_right = size, value
            f_left *= 0.5
        if right - left <= narrow or abs(value) <= small:
            break
    return size


@kernel
def static_overlap(law, p, push, within):
    """Overlap [m] at which the elastic force alone reaches `push` [N], to the relative accuracy `within`."""
    low, high = 1e-18, 1e3
    for _ in range(100):
        middle = math.sqrt(low * high)
        if force(law, middle, 0.0, middle, p) < push:
            low = middle
        else:
            high = middle
        if high < (1.0 + within) * low:
            break
    return high
