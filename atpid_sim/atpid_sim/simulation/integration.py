# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a scene to a run of the engine: one object for every caller."""

from __future__ import annotations

import math
from copy import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np

from atpid_sim.contact.laws import IMPACT
from atpid_sim.engine import columns, drive
from atpid_sim.engine.contact_table import NO_TABLE, ContactTable
from atpid_sim.engine.row_loop import IN_CONTACT, Fidelity, integrate, pass_sections
from atpid_sim.engine.sections import sections_of
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import contact_of, system_of
from atpid_sim.modal import coupling, resting, static_response
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.scene import Scene, SceneError
from atpid_sim.scene.structure import Initial
from atpid_sim.simulation.contact_tables import table_of
from atpid_sim.simulation.energy import Ledger, ledger_of
from atpid_sim.simulation.excitation import amplitude_at, frequency_at, frequency_points, support_rows
from atpid_sim.system import Array, System, structure_of

#: Names of the fidelity levels, from the cheapest to the most complete.
FIDELITIES = ("simplified", "impact", "finite", "soft")
#: Columns of the drive table that are proportional to the support's motion.
SUPPORT = [columns.A0, columns.A1, columns.C0, columns.C1, columns.C2, columns.C3]
#: Loosest relative tolerance of the integrator: beyond, a step's error is the size of what it computes.
_LOOSEST = 0.1
#: Residual of the energy ledger from which a run must not be used.
OPEN = 0.1
#: The integrator's relative tolerance is this share of the amplitude error asked for (docs/research/tradeoff.md).
_TOLERANCE_SHARE = 0.3
#: Steps any run may take, hundreds of times those of the standard task, and more for every cycle of beam or drive,
#: eight times those of the standard task: no run is endless, a hard case still ends, and so does a very long one.
_STEPS = 5_000_000
_STEPS_PER_CYCLE, _STEPS_PER_ROW = 1_000, 20
#: Largest coupling of the modes of a structure with its grain held (`modal.coupling`) that may be left out.
_MOST_COUPLED = 0.5
#: Share of the static deflection, or of the grain's radius, below which a displacement is negligible.
_NEGLIGIBLE = 1e-8


def sample_series(count: int) -> Array:
    """Return an empty series for `count` samples."""
    return np.zeros((columns.SAMPLE_ROWS, count))


def impact_log(capacity: int) -> Array:
    """Return an empty log for `capacity` impacts."""
    return np.zeros((capacity, columns.IMPACT_COLUMNS))


class Observation(NamedTuple):
    """What a run records; the arrays are filled in place."""

    window: tuple[float, float] = (math.inf, math.inf)  # in which the range of the beam is taken: row ends [s]
    first: float = 0.0  # instant of the first sample [s]
    period: float = 1.0  # of the samples [s]
    samples: Array = sample_series(0)  # (SAMPLE_ROWS, n)
    impacts: Array = impact_log(0)  # (capacity, IMPACT_COLUMNS)


NO_OBSERVATION = Observation()


class FinishedRun(NamedTuple):
    """A run that has reached its end: its last state, what was observed, and its energy ledger."""

    last: State
    samples: Array  # those written (SAMPLE_ROWS, k)
    impacts: Array  # those logged (k, IMPACT_COLUMNS)
    ledger: Ledger


class Integration:
    """A scene's system at one fidelity and tolerance: advances states through drive tables."""

    def __init__(
        self,
        scene: Scene,
        fidelity: str,
        rtol: float | None = None,
        mass: float | None = None,
        table: Array | None = None,
        start: State | None = None,
    ) -> None:
        """Prepare the integration of a scene.

        rtol: relative tolerance of the integrator, by default that of the scene (`rtol_of`). mass: what moves at the
        fidelity simplified [kg], by default beam and grain where the ceiling stays closed, else the beam. table: that
        of the whole scene, where the caller has it already. start: state in which the run goes on, by default that of
        the scene at time zero. Raises SceneError for an unknown fidelity, a tolerance out of range, or fidelity soft
        and a law without a force.
        """
        self.scene = scene
        self.system, self.contact = system_of(scene), contact_of(scene)
        self.sections = sections_of(0 if self.system.modes is None else self.system.modes.shape[1])
        self._set_level(fidelity, rtol_of(scene) if rtol is None else float(rtol))
        self._table, self._start = table, start
        self._mass = mass or (scene.total_mass if is_closed(scene) else scene.beam.mass)
        ends = frequency_at(scene, 0.0), frequency_at(scene, scene.duration)
        tones = [f for f in (*ends, *(f for _, f in frequency_points(scene))) if math.isfinite(f)]
        self._fastest = max(scene.natural_frequency_hz, *tones)  # of beam and drive [Hz]

    def _set_level(self, fidelity: str, rtol: float) -> None:
        if fidelity not in FIDELITIES:
            raise SceneError(f"fidelity {fidelity!r}: allowed are {', '.join(FIDELITIES)}")
        if not 0.0 < rtol <= _LOOSEST:
            raise SceneError(f"rtol: given {rtol:g}; allowed: above 0 and at most {_LOOSEST:g}")
        if fidelity in ("finite", "soft") and self.contact.law == IMPACT:
            without = "the contact law impact has no force to integrate"
            raise SceneError(f"fidelity {fidelity}: {without}; use fidelity impact, or another law")
        if fidelity == "impact" and self.scene.modes is not None and coupling(self.scene.modes) > _MOST_COUPLED:
            raise SceneError(
                "fidelity impact: the damping of the modes couples them while the grain is held, by "
                f"{coupling(self.scene.modes):.2g} of what keeps them apart; allowed: at most {_MOST_COUPLED:g}; "
                "use fidelity soft and a contact law with a force"
            )
        self.fidelity, self.rtol = fidelity, rtol
        self._fidelity = int(Fidelity[fidelity.upper()])
        self._contacts = table_of(self.system, self.contact)[0] if fidelity == "finite" else NO_TABLE

    def at_level(self, fidelity: str, rtol: float) -> Integration:
        """Return the same integration at another fidelity level and relative tolerance; raises as the constructor."""
        other = copy(self)
        other._set_level(fidelity, rtol)
        return other

    @cached_property
    def table(self) -> Array:
        """The drive table of the whole scene, with row ends at the steady window."""
        return drive_table(self.scene, self.scene.steady_window) if self._table is None else self._table

    @property
    def step_limit(self) -> int:
        """Steps a run of the whole scene may take before it ends as STEP_BUDGET."""
        return self._limit(self.table)

    def _limit(self, table: Array) -> int:
        """Return the steps a run through a table may take; each of its rows takes some at least."""
        duration = table[-1, columns.END] - table[0, columns.START]
        return _STEPS + int(_STEPS_PER_CYCLE * duration * self._fastest) + _STEPS_PER_ROW * len(table)

    def initial_state(self, disturbance: float = 0.0) -> State:
        """Return the state at time zero: at rest under the weight, deflected, or the scene's own (Eqs 3.41, 3.42).

        disturbance: relative change of the beam's first displacement, for judging reproducibility.
        """
        if self._start is not None:
            state = self._start.copy()
            state.restart_observation()
            state.restart_steps()
            self.disturb(state, disturbance * max(abs(state.beam), self.scene.grain.radius))
            return state
        initial, deflection = self.scene.initial or Initial(), self.scene.initial_deflection
        beam = deflection - self.scene.static_deflection
        size = abs(beam) if beam != 0.0 else self.scene.grain.radius
        modes = self.resting_modes
        if modes is not None:
            modes[0] += deflection + disturbance * size, initial.velocity
        state = State.resting(beam + disturbance * size, initial.velocity, modes)
        if initial.grain_height > 0.0 or initial.grain_speed > initial.velocity:
            state.release_grain(initial.grain_height, initial.grain_speed)
        return state

    def disturb(self, state: State, by: float) -> None:
        """Displace beam and grain [m]."""
        state.y[[columns.BEAM, columns.GRAIN]] += by

    @property
    def resting_modes(self) -> Array | None:
        """Displacements and velocities (modes, 2) at rest under the weight of structure and grain; None: one mode."""
        if self.scene.modes is None:
            return None
        rest = resting(self.scene.modes.joined)
        return self.scene.modes.from_joined @ np.column_stack((rest, np.zeros(len(rest))))

    @property
    def static_response(self) -> float:
        """How far the beam moves at most under a constant unit of the drive: of a force [m/N]."""
        return static_response(structure_of(self.system, held=False))

    def sizes(self, frequency: float) -> Array:
        """Return the sizes (n,) of a section state where the beam moves by a unit at a frequency [Hz].

        Velocities are alike, and what a further mode of a higher frequency moves by at that velocity is less.
        """
        pace, modes = 2.0 * math.pi * frequency, structure_of(self.system, held=False)
        fast = np.sqrt(modes.stiffness[1:] / modes.mass[1:])
        moved = np.array((1.0, *np.minimum(1.0, pace / fast), 1.0))
        return np.column_stack((moved, np.full(len(moved), pace))).ravel()[: len(self.sections.places)]

    @property
    def kernel_inputs(self) -> tuple[int, System, float, int, Array, float, ContactTable]:
        """What every kernel of a run takes: fidelity, system, mass, law and its parameters, rtol, table of contacts."""
        return self._fidelity, self.system, self._mass, *self.contact, self.rtol, self._contacts

    def warm_up(self) -> None:
        """Compile the engine, or load it from the cache, so that a timed run does neither."""
        self.advance(self.initial_state(), np.zeros((0, columns.DRIVE_COLUMNS)), limit=1)

    def advance(
        self, state: State, table: Array, observation: Observation = NO_OBSERVATION, limit: int | None = None
    ) -> Outcome:
        """Advance a state in place from its time to the end of a drive table; return how that ended.

        limit: steps it may take, by default as many as its duration allows.
        """
        window, first, period, samples, impacts = observation
        most, y, n = self._limit(table) if limit is None else limit, state.y, state.n
        return Outcome(integrate(self.kernel_inputs, table, y, n, window, (first, period), samples, impacts, most))

    def advance_whole(self, state: State, table: Array, observation: Observation = NO_OBSERVATION) -> None:
        """Advance a state in place as `advance` does; raise NumericalFailure where it does not reach the end."""
        outcome = self.advance(state, table, observation)
        if outcome != Outcome.DONE:
            raise NumericalFailure(outcome.sentence)

    def pass_sections(self, sections: Array, table: Array, count: int) -> tuple[Array, str]:
        """Return states of free flight (k, n) mapped through a table, and why the next one of `count` is missing.

        sections (runs, n): section states (`engine.sections`); runs beyond these go on from the one before. The grain
        has to fly at the end. One call of compiled code.
        """
        after = np.empty((count, sections.shape[1]))
        done, ended = pass_sections(self.kernel_inputs, table, self.sections, sections, after, self._limit(table))
        if done == count:
            return after, ""
        grounded = "the grain is in contact at the phase of the section"
        return after[:done], grounded if ended == IN_CONTACT else Outcome(ended).sentence

    def run(
        self,
        observation: Observation = NO_OBSERVATION,
        table: Array | None = None,
        limit: int | None = None,
        disturbance: float = 0.0,
    ) -> FinishedRun:
        """Integrate from the initial state through a table, by default that of the scene.

        Raises NumericalFailure with outcome, time and state where the run does not reach its end.
        """
        rows = self.table if table is None else table
        state = self.initial_state(disturbance)
        first = state.copy()
        outcome = self.advance(state, rows, observation, self.step_limit if limit is None else limit)
        if outcome != Outcome.DONE:
            raise NumericalFailure(failure_at(outcome, state))
        samples = observation.samples[:, : state.n[columns.SAMPLE]]
        impacts = observation.impacts[: state.n[columns.IMPACTS]]
        ledger = self.ledger(first, state, rows)
        if abs(ledger.residual) > OPEN:
            raise NumericalFailure(failure_at(Outcome.LEDGER_OPEN, state))
        return FinishedRun(state, samples, impacts, ledger)

    def ledger(self, first: State, last: State, table: Array) -> Ledger:
        """Return the energy ledger between two states of a run through `table`."""
        return ledger_of(self.system, self.contact, table, first, last)


def failure_at(outcome: Outcome, state: State) -> str:
    """Return a sentence: how a run ended, where and with what state."""
    return (
        f"{outcome.sentence} (at {state.time:.6f} s: beam {state.beam:.6g} m, "
        f"grain {state.grain:.6g} m above its rest, {state.steps} steps)"
    )


def rtol_of(scene: Scene) -> float:
    """Return the relative tolerance at which the integrator meets the amplitude error that a scene asks for."""
    return min(_TOLERANCE_SHARE * scene.tolerance, _LOOSEST)


def is_closed(scene: Scene) -> bool:
    """Return whether the ceiling holds the grain during the whole run."""
    return max(height for _, height in scene.ceiling.heights) <= closed_up_to(scene)


def closed_up_to(scene: Scene) -> float:
    """Return the height up to which a ceiling holds the grain [m]."""
    return 2.0 * scene.grain.radius * (1.0 + 1e-9)


def drive_table(scene: Scene, edges: tuple[float, ...] = ()) -> Array:
    """Return the drive table (rows, columns) of a scene, with row ends also at the given times [s]."""
    rows = drive.cut(support_rows(scene), [t for t in edges if 0.0 < t < scene.duration])
    return drive.with_ceiling(rows, scene.ceiling.heights)


def negligible_displacement(scene: Scene) -> float:
    """Return the amplitude [m] below which a beam is at rest: the vibration of a grain set down on it is smaller."""
    return _NEGLIGIBLE * max(scene.static_deflection, scene.grain.radius)


def undamped_amplitude(scene: Scene, table: Array | None = None) -> float:
    """Return the half peak-to-peak of the closed damper in the steady window [m]: beam and grain as one mass."""
    return _linear_amplitude(Integration(scene, "simplified", mass=scene.total_mass, table=table))


def _linear_amplitude(one_mass: Integration) -> float:
    """Return the half peak-to-peak of one mass in the steady window [m]."""
    state = one_mass.initial_state()
    one_mass.advance(state, one_mass.table, Observation(one_mass.scene.steady_window))
    return state.amplitude


def amplitude_without_damper(scene: Scene) -> float:
    """Return half peak-to-peak of the structure as it is without the damper in the steady window [m].

    In closed form where a tone is constant there, else of a run that begins at rest; NaN for a free decay.
    """
    if scene.excitation.is_free:
        return math.nan
    tone = [{of(scene, t) for t in scene.steady_window} for of in (amplitude_at, frequency_at)]
    if scene.excitation.is_tone and all(len(values) == 1 for values in tone):
        return scene.linear_amplitude(*(values.pop() for values in tone), grain=False)
    without = scene.with_(gravity=0.0, initial=None)  # at rest at first, where a smaller mass hangs higher
    return _linear_amplitude(Integration(without, "simplified", mass=scene.beam.mass))
