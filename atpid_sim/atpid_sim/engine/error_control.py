# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of the integration: the budget of steps, and how finely contacts are integrated."""

import math
from typing import NamedTuple

from atpid_sim.contact.dispatch import restitution
from atpid_sim.engine.columns import A0, A1, BEAM, BEAM_VELOCITY, C0, C2, END, OMEGA, START
from atpid_sim.engine.detachment import static_overlap
from atpid_sim.engine.modes import container_mass, resting_place
from atpid_sim.kernel import kernel

#: Share of the tolerance with which the contacts of an elastic grain are integrated, and the finest there is.
_ELASTIC = 0.01
_FINEST = 1e-12
#: Overlaps are measured to the relative tolerance of at least this share of the beam's displacement: an error of an
#: overlap moves the beam by no more than itself, and finer control of micrometres of overlap gains nothing.
DEPTH_FLOOR = 0.01


class ErrorControl(NamedTuple):
    """Budget and error control of one run."""

    budget: int  # steps
    rtol: float  # relative tolerance of the run
    contact_rtol: float  # that of its contacts
    overlap: float  # below these sizes errors count as absolute: overlap [m]
    velocity: float  # of the overlap [m/s]
    displacement: float  # of the beam [m]


@kernel
def control_of(table, system, law, p, rtol, budget, y):
    """`ErrorControl` of a run with force-based contacts from state y through the drive table."""
    overlap, velocity, displacement = _error_scale(table, system, law, p, y)
    contact_rtol = _contact_tolerance(system, law, p, rtol, overlap, velocity)
    return ErrorControl(budget, rtol, contact_rtol, overlap, velocity, displacement)


@kernel
def _error_scale(table, system, law, p, y):
    """Overlap [m], overlap velocity [m/s] and displacement [m] below which the errors of a contact count as absolute.

    The overlap is a tenth of the static one under a twentieth of the run's typical acceleration, weight included; the
    displacement a thousandth of the run's typical one.
    """
    natural = system.stiffness / system.beam_mass
    rest = resting_place(system.modes, system)
    motion = natural * abs(y[BEAM] - rest) + math.sqrt(natural) * abs(y[BEAM_VELOCITY])
    for row in range(table.shape[0]):
        a0, a1, omega = abs(table[row, A0]), abs(table[row, A1]), table[row, OMEGA]
        amplitude = max(a0, a0 + a1 * (table[row, END] - table[row, START]))
        motion = max(
            motion, min(omega * omega, natural) * amplitude, 2.0 * abs(table[row, C2]), natural * abs(table[row, C0])
        )
    pace = max(0.05 * (motion + system.gravity), 1e-12)
    overlap = 0.1 * static_overlap(law, p, system.grain_mass * pace, 0.1)
    return overlap, math.sqrt(pace * overlap), 1e-3 * motion / natural + overlap


@kernel
def _contact_tolerance(system, law, p, rtol, overlap, velocity):
    """Tolerance for contacts: an error of the energy in one contact of an elastic grain lasts for 1 / (1 - e) more.

    Restitution is taken where it is largest, at the slow or at the fast end of the run's impacts.
    """
    beam_mass = container_mass(system.modes, system)
    reduced = beam_mass * system.grain_mass / (beam_mass + system.grain_mass)
    slow, fast = velocity, velocity * math.sqrt(system.radius / overlap)
    e = max(restitution(law, slow, reduced, p), restitution(law, fast, reduced, p))
    return max(rtol * min(1.0, max(_ELASTIC, 2.0 * (1.0 - e))), min(rtol, _FINEST))
