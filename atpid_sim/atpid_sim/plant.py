# SPDX-License-Identifier: Apache-2.0
"""The plant as a stream: advanced block by block while somebody else moves the ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_sim.contact import contact_of
from atpid_sim.engine import drive, state
from atpid_sim.excitation import amplitude_at, frequency_at, support_rows
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.run import Stepper, held_by_contact, initial_state, stepper_of, stored_energy
from atpid_sim.scene import Scene
from atpid_sim.system import system_of

Array = NDArray[np.float64]

#: Steps one block may take before the run is given up: ten times what the extremes of the thesis's range need.
_BLOCK_BUDGET = 2_000_000


@dataclass(frozen=True)
class PlantBlock:
    """What happened in one block: series (n,) at the block's sample instants, and the ledger since the start."""

    time: Array  # [s]
    support: Array  # displacement [m]
    beam: Array  # displacement [m]
    beam_velocity: Array  # [m/s]
    beam_acceleration: Array  # [m/s^2]
    grain: Array  # displacement [m]
    ceiling: Array  # height above the floor [m]
    impacts: int  # since the start
    input_energy: float  # work of the support since the start [J]
    beam_loss: float  # [J]
    contact_loss: float  # [J]
    ceiling_work: float  # [J]
    stored_energy: float  # relative to the start [J]
    excitation_amplitude: float  # at the end of the block [m]
    excitation_frequency: float  # at the end of the block [Hz]
    outcome: Outcome


class Plant:
    """A beam with its damper, from rest; `advance` moves it on by a whole number of samples.

    Time is an integer count of ticks times the tick, never a sum of steps.
    """

    def __init__(self, scene: Scene, fidelity: str = "soft") -> None:
        """Start at rest at time zero; raises ValueError for a rung that cannot follow a commanded ceiling."""
        self._scene = scene
        self._system = system_of(scene)
        self._contact = contact_of(scene)
        self._run: Stepper = stepper_of(scene, fidelity)
        self._rows = support_rows(scene)
        self._y, self._n = initial_state(scene)
        self._energy_at_start = stored_energy(self._system, self._y, 0.0)
        self._ticks = 0
        self.height = float(scene.ceiling.heights[0][1])

    @property
    def time(self) -> float:
        """Where the plant stands [s]."""
        return float(self._y[state.TIME])

    def advance(self, duration_ticks: int, rate: float, target: float, speed: float) -> PlantBlock:
        """Advance by `duration_ticks` samples at `rate` [Hz], the ceiling going toward `target` [m] at `speed` [m/s].

        A speed of 0 holds it. Samples are at the start of the run plus i / rate. Raises NumericalFailure with time and
        state where the motion cannot be followed: what was computed up to there is lost with the plant.
        """
        begin, end = self._ticks / rate, (self._ticks + duration_ticks) / rate
        table = self._table(begin, end, target, speed)
        out = np.zeros((state.ROWS, duration_ticks))
        self._n[state.SAMPLE] = 0
        self._n[[state.CONTACT_STEPS, state.FLIGHT_STEPS, state.REJECTED]] = 0
        outcome = self._run(table, self._y, self._n, (end, end), (begin, 1.0 / rate), out, _NO_LOG, _BLOCK_BUDGET)
        if outcome != Outcome.DONE:
            raise NumericalFailure(
                f"{outcome.sentence} (at {self._y[state.TIME]:.6f} s, beam {self._y[state.BEAM]:.6g} m, "
                f"grain {self._y[state.GRAIN]:.6g} m, ceiling {self.height:.6g} m)"
            )
        self._ticks += duration_ticks
        self.height = float(
            table[-1, drive.HEIGHT] + table[-1, drive.HEIGHT_RATE] * (table[-1, drive.END] - table[-1, drive.START])
        )
        if speed > 0.0 and abs(self.height - target) < 1e-12:
            self.height = target
        return self._block(begin, end, rate, table, out, outcome)

    def _table(self, begin: float, end: float, target: float, speed: float) -> Array:
        way = abs(target - self.height)
        points = [(begin, self.height)]
        if speed > 0.0 and way > 0.0:
            arrival = begin + way / speed
            share = min(1.0, (end - begin) / (arrival - begin))
            points.append((min(arrival, end), self.height + share * (target - self.height)))
        return drive.with_ceiling(drive.between(self._rows, begin, end), points)

    def _block(self, begin: float, end: float, rate: float, table: Array, out: Array, outcome: Outcome) -> PlantBlock:
        y, n = self._y, self._n
        held = held_by_contact(self._contact, self._system, y, int(n[state.MODE]), table)
        stored = stored_energy(self._system, y, self._support_at(end)) + held
        return PlantBlock(
            time=begin + np.arange(out.shape[1]) / rate,
            support=out[state.S_SUPPORT],
            beam=out[state.S_BEAM],
            beam_velocity=out[state.S_RATE],
            beam_acceleration=out[state.S_ACCELERATION],
            grain=out[state.S_GRAIN],
            ceiling=out[state.S_CEILING],
            impacts=int(n[state.FLOOR_HITS] + n[state.CEILING_HITS]),
            input_energy=float(y[state.INPUT]),
            beam_loss=float(y[state.BEAM_LOSS]),
            contact_loss=float(y[state.CONTACT_LOSS]),
            ceiling_work=float(y[state.CEILING_WORK]),
            stored_energy=stored - self._energy_at_start,
            excitation_amplitude=amplitude_at(self._scene, end),
            excitation_frequency=frequency_at(self._scene, end),
            outcome=outcome,
        )

    def _support_at(self, t: float) -> float:
        return drive.support_displacement(self._rows, t)


_NO_LOG = np.zeros((0, state.COLUMNS))
