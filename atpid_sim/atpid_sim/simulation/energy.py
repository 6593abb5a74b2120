# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The energy ledger of a run: where the work of the support went."""

from dataclasses import dataclass

from atpid_sim.contact import dispatch
from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine import columns, drive
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import Contact
from atpid_sim.results import Labelled, in_unit
from atpid_sim.system import Array, System, structure_of


@dataclass(frozen=True, repr=False)
class Ledger(Labelled):
    """Energy flows since the start [J] and their relative residual.

    The residual is what does not add up, relative to all flows and to the largest energy of the spring at either end,
    so that it stays meaningful in a run with next to no motion.
    """

    input: float
    beam_loss: float
    contact_loss: float
    ceiling_work: float
    stored: float
    residual: float

    labels = in_unit("J", "input beam_loss contact_loss ceiling_work stored")


def ledger_of(system: System, contact: Contact, table: Array, first: State, last: State) -> Ledger:
    """Return the ledger between two states of a run through `table`."""
    start_u, end_u = (drive.support_displacement(table, state.time) for state in (first, last))
    work, beam_loss, contact_loss, ceiling = (
        float(last.y[k] - first.y[k])
        for k in (columns.INPUT, columns.BEAM_LOSS, columns.CONTACT_LOSS, columns.CEILING_WORK)
    )
    stored = stored_energy(system, last, end_u) - stored_energy(system, first, start_u)
    stored += contact_energy(contact, system, last, table)
    sprung = max(_sprung(system, first.y, start_u), _sprung(system, last.y, end_u))
    residual = relative_residual(work, beam_loss, contact_loss, ceiling, stored, sprung)
    return Ledger(work, beam_loss, contact_loss, ceiling, stored, residual)


def relative_residual(
    work: float, beam_loss: float, contact_loss: float, ceiling: float, stored: float, sprung: float
) -> float:
    """Return what does not add up [-]: of flows [J] and the change of the stored energy [J].

    It is relative to all of them and to `sprung` [J], the largest energy of the spring at either end.
    """
    turnover = sum(abs(flow) for flow in (work, beam_loss, contact_loss, ceiling)) + abs(stored) + sprung
    gap = stored - (work - beam_loss - contact_loss + ceiling)
    return float(gap / turnover if turnover > 0.0 else gap)


def stored_energy(system: System, state: State, support: float) -> float:
    """Return kinetic, elastic and potential energy [J] of beam and grain, with the support at `support` [m].

    The energy of a contact is not in it (see `contact_energy`).
    """
    y = state.y
    beam, velocity, grain, grain_velocity = y[columns.BEAM : columns.GRAIN_VELOCITY + 1]
    if system.modes is not None:
        modes, states = structure_of(system, held=False), _mode_states(y, system.modes.shape[1])
        q, rate = states[:, columns.Q], states[:, columns.Q_RATE]
        own = 0.5 * modes.mass * rate**2 + 0.5 * modes.stiffness * q**2 + modes.mass * modes.gravity * q
        return float(own.sum() + system.grain_mass * (0.5 * grain_velocity**2 + system.gravity * grain))
    stretch = beam - support
    return float(
        0.5 * system.beam_mass * velocity**2
        + 0.5 * system.grain_mass * grain_velocity**2
        + 0.5 * system.stiffness * stretch**2
        + system.gravity * (system.beam_mass * beam + system.grain_mass * grain)
    )


def _sprung(system: System, y: Array, support: float) -> float:
    """Return the elastic energy of the structure [J]."""
    if system.modes is not None:
        places = _mode_states(y, system.modes.shape[1])[:, columns.Q]
        return float(0.5 * (structure_of(system, held=False).stiffness * places**2).sum())
    return float(0.5 * system.stiffness * (y[columns.BEAM] - support) ** 2)


def _mode_states(y: Array, modes: int) -> Array:
    """Return the modes' part (modes, MODE_COLUMNS) of a state (n,)."""
    part = y[columns.STATE_SIZE : columns.STATE_SIZE + modes * columns.MODE_COLUMNS]
    return part.reshape(-1, columns.MODE_COLUMNS)


def contact_energy(contact: Contact, system: System, state: State, table: Array) -> float:
    """Return the elastic energy of a present contact [J]; 0 unless a wall pushes the grain."""
    if contact.law == IMPACT or state.mode not in (columns.ON_FLOOR, columns.ON_CEILING):
        return 0.0
    gap = state.grain - state.beam
    overlap = max(0.0, -gap, gap - (drive.ceiling_height(table, state.time) - 2.0 * system.radius))
    return float(dispatch.energy(contact.law, overlap, state.y[columns.DEEPEST], contact.parameters))
