# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where kernels keep what they compute of several modes: in rows below the modes' table, made once for a run.

An array in a tuple is counted at every assignment, which took more time than the modes; one without an owner is not.
So a run copies its table into one that it owns until its end, and hands on an array that owns nothing.
"""

import numpy as np
from numba.core.cgutils import get_null_value
from numba.extending import intrinsic

from atpid_sim.engine import columns as at
from atpid_sim.kernel import chosen, kernel
from atpid_sim.system import System

# Rows below those of the table: numbers of an arc, the modes at both ends of a step, then those of its stages.
_ARC, _ENDS, _STAGES, _ROWS = 0, 20, 32, 62
#: Columns of a mode in a contact: those of the state, and its acceleration.
Q_ACCELERATION, END_ROWS = at.MODE_COLUMNS, at.MODE_COLUMNS + 1


@intrinsic
def unowned(typing_context, array):
    """Return the same array without a reference to its owner, which has to outlive it."""

    def generate(context, builder, signature, arguments):
        made = context.make_array(signature.return_type)(context, builder, value=arguments[0])
        made.meminfo, made.parent = get_null_value(made.meminfo.type), get_null_value(made.parent.type)
        return made._getvalue()

    return array(array), generate


def _as_it_is(modes, system):
    return system, None


def _with_room(modes, system):
    own = np.zeros((modes.shape[0] + _ROWS, modes.shape[1]))
    own[: modes.shape[0]] = modes
    own[modes.shape[0] + _STAGES] = 1.0 / modes[at.MASS]
    beam, grain, stiffness, damping, gravity, radius, _ = system
    return System(beam, grain, stiffness, damping, gravity, radius, unowned(own)), own


#: (modes, system) -> the system with room for what is computed, and what owns it; of one mode as it is, and None.
with_room = chosen(_as_it_is, _with_room)


def _nothing(owner):
    return None


def _last_use(owner):
    owner[0, 0] += 0.0


#: (owner): keeps the room until here.
keep = chosen(_nothing, _last_use)


@kernel
def _room(modes):
    return 2 * (at.SET_ROWS + modes.shape[1])


@kernel
def arc_row(modes):
    """First row of an arc's numbers."""
    return _room(modes) + _ARC


@kernel
def end_row(modes, end):
    """First row of the modes (END_ROWS, modes) at an end of a contact's step: 0 or 1."""
    return _room(modes) + _ENDS + end * END_ROWS


@kernel
def stage_row(modes):
    """First row of what a step keeps: reciprocal masses, a free row, then those of the stages."""
    return _room(modes) + _STAGES
