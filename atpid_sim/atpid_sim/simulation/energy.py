# SPDX-License-Identifier: Apache-2.0
"""The energy ledger of a run: where the work of the support went."""

from dataclasses import dataclass

from atpid_sim.contact import dispatch
from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine import columns, drive
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import Contact
from atpid_sim.system import Array, System


@dataclass(frozen=True)
class Ledger:
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


def ledger_of(system: System, contact: Contact, table: Array, first: State, last: State) -> Ledger:
    """Return the ledger between two states of a run through `table`."""
    support = [drive.support_displacement(table, state.time) for state in (first, last)]
    before, after = (stored_energy(system, state, u) for state, u in zip((first, last), support, strict=True))
    flows = [
        float(last.y[k] - first.y[k])
        for k in (columns.INPUT, columns.BEAM_LOSS, columns.CONTACT_LOSS, columns.CEILING_WORK)
    ]
    work, beam_loss, contact_loss, ceiling = flows
    stored = after - before + contact_energy(contact, system, last, table)
    sprung = max(
        0.5 * system.stiffness * (state.beam - u) ** 2 for state, u in zip((first, last), support, strict=True)
    )
    turnover = sum(abs(flow) for flow in flows) + abs(stored) + sprung
    gap = stored - (work - beam_loss - contact_loss + ceiling)
    return Ledger(work, beam_loss, contact_loss, ceiling, stored, gap / turnover if turnover > 0.0 else 0.0)


def stored_energy(system: System, state: State, support: float) -> float:
    """Return kinetic, elastic and potential energy [J] of beam and grain, with the support at `support` [m].

    The energy of a contact is not in it (see `contact_energy`).
    """
    stretch = state.beam - support
    return (
        0.5 * system.beam_mass * state.beam_velocity**2
        + 0.5 * system.grain_mass * state.grain_velocity**2
        + 0.5 * system.stiffness * stretch**2
        + system.gravity * (system.beam_mass * state.beam + system.grain_mass * state.grain)
    )


def contact_energy(contact: Contact, system: System, state: State, table: Array) -> float:
    """Return the elastic energy of a present contact [J]; 0 unless a wall pushes the grain."""
    if contact.law == IMPACT or state.mode not in (columns.ON_FLOOR, columns.ON_CEILING):
        return 0.0
    gap = state.grain - state.beam
    overlap = max(0.0, -gap, gap - (drive.ceiling_height(table, state.time) - 2.0 * system.radius))
    return float(dispatch.energy(contact.law, overlap, state.y[columns.DEEPEST], contact.parameters))
