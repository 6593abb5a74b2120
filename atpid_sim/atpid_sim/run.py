# SPDX-License-Identifier: Apache-2.0
"""Runs: which stepper carries a scene, from which state, and what the energy ledger says afterwards."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from atpid_sim.contact import Contact, contact_of, dispatch
from atpid_sim.contact.ids import IMPACT, WALTON_BRAUN
from atpid_sim.engine import drive, soft, state
from atpid_sim.engine.one_mass import run_one_mass
from atpid_sim.excitation import frequency_at, support_rows
from atpid_sim.outcome import Outcome
from atpid_sim.scene import FreeExcitation, Scene
from atpid_sim.system import System, system_of

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

#: First step of a first contact, as the fourth root of a time [s^(1/4)]; later contacts remember their own.
_FIRST_STEP = 0.05

#: Steps any run may take, hundreds of times those of the standard task, and what every cycle of beam or drive adds to
#: them, eight times the standard task's: a hang is impossible, a hard case still ends, and so does a very long one.
_BUDGET = 5_000_000
_BUDGET_PER_CYCLE = 1_000

#: Loosest tolerance of a run: beyond, a step's error is the size of what it computes.
LOOSEST = 0.1

#: Share of the static deflection, or of the grain's radius, that is no swing.
_STILL = 1e-8

FIDELITIES = ("simplified", "impact", "soft")


class Stepper(Protocol):
    """One rung of the ladder: carries a state through a drive table and says how it ended."""

    def __call__(
        self,
        table: Array,
        y: Array,
        n: Counts,
        observe: tuple[float, float],
        sampling: tuple[float, float],
        out: Array,
        events: Array,
        budget: int,
    ) -> Outcome:
        """Advance y and n (see `engine.state`) to the table's end; observe, sampling: [s]; out (6, samples)."""


def stepper_of(scene: Scene, fidelity: str, rtol: float | None = None) -> Stepper:
    """Return the stepper of a rung for this scene; `rtol` defaults to the scene's tolerance.

    Raises ValueError for an unknown rung, a tolerance that is none, or a soft rung asked to integrate a law that has no
    force.
    """
    system, contact = system_of(scene), contact_of(scene)
    tolerance = float(min(scene.tolerance, LOOSEST) if rtol is None else rtol)
    if not 0.0 < tolerance <= LOOSEST:
        raise ValueError(f"rtol: given {tolerance:g}; allowed: above 0 and at most {LOOSEST:g}")
    if fidelity == "soft":
        if contact.law == IMPACT:
            raise ValueError(
                "fidelity soft: the contact law impact has no force to integrate; use fidelity impact, or another law"
            )
        return _soft(system, contact, tolerance)
    if fidelity == "impact":
        from atpid_sim.engine.impact import impact_stepper

        return impact_stepper(system, contact)
    if fidelity == "simplified":
        return _one_mass(system, swinging_mass(scene))
    raise ValueError(f"fidelity {fidelity!r}: allowed are {', '.join(FIDELITIES)}")


def swinging_mass(scene: Scene) -> float:
    """Return what the simplified rung takes as its one mass [kg]: beam and grain where closed, else the beam."""
    return scene.total_mass if is_closed(scene) else scene.beam.mass


def is_closed(scene: Scene) -> bool:
    """Return whether the ceiling holds the grain during the whole run."""
    diameter = 2.0 * scene.grain.radius
    return max(height for _, height in scene.ceiling.heights) <= diameter * (1.0 + 1e-9)


def _soft(system: System, contact: Contact, rtol: float) -> Stepper:
    hysteretic = contact.law == WALTON_BRAUN

    def run(table, y, n, observe, sampling, out, events, budget):  # type: ignore[no-untyped-def]
        law, p = contact
        return Outcome(soft.run(table, system, law, hysteretic, p, rtol, y, n, observe, sampling, out, events, budget))

    return run


def _one_mass(system: System, mass: float) -> Stepper:
    def run(table, y, n, observe, sampling, out, events, budget):  # type: ignore[no-untyped-def]
        return Outcome(run_one_mass(table, system, mass, y, n, observe, sampling, out, budget))

    return run


def initial_state(scene: Scene, disturbance: float = 0.0) -> tuple[Array, Counts]:
    """Return the state at time zero: at rest under the weight, or released from a deflection (equations 3.41, 3.42).

    `disturbance`: relative change of the beam's first displacement, for judging reproducibility.
    """
    excitation = scene.excitation
    released = excitation.free.deflection if isinstance(excitation, FreeExcitation) else 0.0
    beam = released - scene.static_deflection
    size = abs(beam) if beam != 0.0 else scene.grain.radius
    y, n = state.at_rest(beam + disturbance * size, 0.0)
    y[state.FIRST_STEP] = _FIRST_STEP
    return y, n


def step_budget(scene: Scene) -> int:
    """Return how many steps a run of this scene may take before it ends as STEP_BUDGET."""
    tones = (frequency_at(scene, 0.0), frequency_at(scene, scene.duration))
    fastest = max([scene.natural_frequency_hz, *(tone for tone in tones if math.isfinite(tone))])
    return _BUDGET + int(_BUDGET_PER_CYCLE * scene.duration * fastest)


def drive_table(scene: Scene, edges: tuple[float, ...] = ()) -> Array:
    """Return the whole drive table (rows, 12) of a scene, with row ends also at the given times [s]."""
    rows = drive.cut(support_rows(scene), [t for t in edges if 0.0 < t < scene.duration])
    return drive.with_ceiling(rows, scene.ceiling.heights)


def nothing(scene: Scene) -> float:
    """Return the swing [m] below which a beam stands still: what is left is the ringing of a grain set down on it."""
    return _STILL * max(scene.static_deflection, scene.grain.radius)


def half_peak_to_peak(y: Array) -> float:
    """Return half the range of the beam in the observed window [m]."""
    return float(0.5 * (y[state.HIGHEST] - y[state.LOWEST]))


def undamped_amplitude(scene: Scene, table: Array) -> float:
    """Return the half peak-to-peak of the closed damper in the steady window [m]: beam and grain as one mass."""
    y, n = initial_state(scene)
    none = np.zeros((state.ROWS, 0))
    system, mass, window = system_of(scene), scene.total_mass, scene.steady_window
    run_one_mass(table, system, mass, y, n, window, (0.0, 1.0), none, step_budget(scene))
    return half_peak_to_peak(y)


def stored_energy(system: System, y: Array, support: float) -> float:
    """Return kinetic, elastic and potential energy [J] of beam and grain, with the support at `support` [m].

    What a contact holds is not in it (see `held_by_contact`).
    """
    stretch = y[state.BEAM] - support
    return float(
        0.5 * system.beam_mass * y[state.BEAM_RATE] ** 2
        + 0.5 * system.grain_mass * y[state.GRAIN_RATE] ** 2
        + 0.5 * system.stiffness * stretch**2
        + system.gravity * (system.beam_mass * y[state.BEAM] + system.grain_mass * y[state.GRAIN])
    )


@dataclass(frozen=True)
class Ledger:
    """Where the energy went since the start [J]; `residual` is what does not add up.

    It is relative to all that flowed and to the largest energy the spring held at either end, so that a run in which
    next to nothing moves is not measured against nothing.
    """

    input: float
    beam_loss: float
    contact_loss: float
    ceiling_work: float
    stored: float
    residual: float


def ledger_of(scene: Scene, table: Array, first: Array, last: Array, mode: int) -> Ledger:
    """Return the ledger between two states of a run through `table` that ended in `mode`."""
    system, contact = system_of(scene), contact_of(scene)
    support = [drive.support_displacement(table, float(y[state.TIME])) for y in (first, last)]
    before, after = (stored_energy(system, y, u) for y, u in zip((first, last), support, strict=True))
    flows = [float(last[k] - first[k]) for k in (state.INPUT, state.BEAM_LOSS, state.CONTACT_LOSS, state.CEILING_WORK)]
    work, beam_loss, contact_loss, ceiling = flows
    stored = after - before + held_by_contact(contact, system, last, mode, table)
    sprung = max(0.5 * system.stiffness * (y[state.BEAM] - u) ** 2 for y, u in zip((first, last), support, strict=True))
    turnover = sum(abs(flow) for flow in flows) + abs(stored) + sprung
    gap = stored - (work - beam_loss - contact_loss + ceiling)
    return Ledger(work, beam_loss, contact_loss, ceiling, stored, gap / turnover if turnover > 0.0 else 0.0)


def held_by_contact(contact: Contact, system: System, y: Array, mode: int, table: Array) -> float:
    """Return the elastic energy a present contact can give back [J]; 0 unless a wall pushes the grain."""
    if contact.law == IMPACT or mode not in (state.ON_FLOOR, state.ON_CEILING):
        return 0.0
    row = table[min(int(np.searchsorted(table[:, drive.START], y[state.TIME], side="right")) - 1, len(table) - 1)]
    height = row[drive.HEIGHT] + row[drive.HEIGHT_RATE] * (y[state.TIME] - row[drive.START])
    lift = y[state.GRAIN] - y[state.BEAM]
    overlap = max(0.0, -lift, lift - (height - 2.0 * system.radius))
    return float(dispatch.energy(contact.law, overlap, y[state.MEMORY], contact.parameters))
