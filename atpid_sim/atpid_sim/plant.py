# SPDX-License-Identifier: Apache-2.0
"""The plant as a stream: advanced block by block while somebody else moves the ceiling."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import index

import numpy as np
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_sim.contact import contact_of
from atpid_sim.contact.ids import IMPACT
from atpid_sim.engine import drive, state
from atpid_sim.excitation import amplitude_at, frequency_at, support_rows
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.run import FIDELITIES, Stepper, held_by_contact, initial_state, is_closed, stepper_of, stored_energy
from atpid_sim.scene import Scene
from atpid_sim.stream import samples_before
from atpid_sim.system import system_of

Array = NDArray[np.float64]

#: Steps one block may take before the run is given up: ten times what the extremes of the thesis's range need.
_BLOCK_BUDGET = 2_000_000

#: Closer to its target than this [m] the ceiling has arrived: a travel of a few digits of the clock is none.
_ARRIVED = 1e-12


class PlantError(InputError):
    """Something a plant cannot do: the message says what was given and what is allowed. The plant stays as it was."""


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

    def __init__(self, scene: Scene, fidelity: str = "auto") -> None:
        """Start at rest at time zero; `auto` is soft, or impact where the contact law has no force.

        Raises PlantError for an unknown rung, and for simplified, which knows no impacts, where the scene's ceiling is
        not closed throughout; ValueError for soft and a law without force.
        """
        self._scene = scene
        self._system = system_of(scene)
        self._contact = contact_of(scene)
        if fidelity not in ("auto", *FIDELITIES):
            raise PlantError(f"fidelity {fidelity!r}: allowed are auto, {', '.join(FIDELITIES)}")
        if fidelity == "auto":
            fidelity = "impact" if self._contact.law == IMPACT else "soft"
        self._run: Stepper = stepper_of(scene, fidelity)
        self._closed_only = fidelity == "simplified"
        if self._closed_only and not is_closed(scene):
            raise PlantError(self._opened(max(height for _, height in scene.ceiling.heights)))
        self._rows = support_rows(scene)
        self._y, self._n = initial_state(scene)
        self._energy_at_start = stored_energy(self._system, self._y, self._support_at(0.0))
        self._ticks = 0
        self._rate: float | None = None  # [Hz], that of the first advance
        self._failure = ""  # why the motion could not be followed any further
        self.height = float(scene.ceiling.heights[0][1])

    @property
    def time(self) -> float:
        """Where the plant stands [s]."""
        return float(self._y[state.TIME])

    def advance(self, duration_ticks: int, rate: float, target: float, speed: float) -> PlantBlock:
        """Advance by `duration_ticks` samples at `rate` [Hz], the ceiling going toward `target` [m] at `speed` [m/s].

        A speed of 0 holds it. Samples are at the start of the run plus i / rate, all before the end of the scene; the
        last block may end up to a tick later than the scene.

        Raises PlantError, and changes nothing, for arguments that are negative or not finite, another rate than before,
        samples beyond the scene's end, and a simplified plant that is to open. Raises NumericalFailure with time and
        state where the motion cannot be followed: the block up to there is lost, `time` and `height` say where it
        stopped, and every further advance raises NumericalFailure with the same reason.
        """
        duration_ticks, rate, target, speed = self._checked(duration_ticks, rate, target, speed)
        if self._failure:
            raise NumericalFailure(f"the plant cannot go on, make a new one: {self._failure}")
        begin, end = self._ticks / rate, (self._ticks + duration_ticks) / rate
        table = self._table(begin, end, target, speed)
        out = np.zeros((state.ROWS, duration_ticks))
        self._n[state.SAMPLE] = 0
        self._n[[state.CONTACT_STEPS, state.FLIGHT_STEPS, state.REJECTED]] = 0
        outcome = self._run(table, self._y, self._n, (end, end), (begin, 1.0 / rate), out, _NO_LOG, _BLOCK_BUDGET)
        self._rate = rate
        if outcome != Outcome.DONE:
            self._fail(outcome, table)
        self._ticks += duration_ticks
        self.height = float(
            table[-1, drive.HEIGHT] + table[-1, drive.HEIGHT_RATE] * (table[-1, drive.END] - table[-1, drive.START])
        )
        if speed > 0.0 and abs(self.height - target) < _ARRIVED:
            self.height = target
        return self._block(begin, end, rate, table, out, outcome)

    def _checked(self, ticks: int, rate: float, target: float, speed: float) -> tuple[int, float, float, float]:
        """Return the arguments of `advance` as plain numbers; raise PlantError where one is not allowed."""
        ticks, rate, target, speed = index(ticks), float(rate), float(target), float(speed)
        if ticks < 1:
            raise PlantError(f"duration_ticks: given {ticks}; allowed: 1 or more")
        if not (math.isfinite(rate) and rate > 0.0):
            raise PlantError(f"rate: given {rate:g} Hz; allowed: finite and above 0")
        if self._rate is not None and rate != self._rate:
            raise PlantError(f"rate: given {rate:g} Hz; allowed: that of the first advance, {self._rate:g} Hz")
        for name, unit, value in (("target", "m", target), ("speed", "m/s", speed)):
            if not (math.isfinite(value) and value >= 0.0):
                raise PlantError(f"{name}: given {value:g} {unit}; allowed: finite and not negative")
        length = float(self._rows[-1, drive.END])
        left = samples_before(length, rate) - self._ticks
        if ticks > left:
            raise PlantError(
                f"duration_ticks: given {ticks} at {self._ticks / rate:g} s; allowed: at most {left}, "
                f"the scene's drive ends at {length:g} s; lengthen its duration"
            )
        if self._closed_only and speed > 0.0 and abs(target - self.height) > 1e-9 * self.height:
            raise PlantError(self._opened(target))
        return ticks, rate, target, speed

    def _opened(self, height: float) -> str:
        return (
            f"fidelity simplified: given a ceiling at {height:g} m; allowed: one that stays closed "
            f"({2.0 * self._system.radius:g} m); use fidelity soft or impact"
        )

    def _fail(self, outcome: Outcome, table: Array) -> None:
        """Raise NumericalFailure with time and state, and remember it."""
        y = self._y
        self.height = _height_at(table, self.time)
        self._failure = (
            f"{outcome.sentence} (at {self.time:.6f} s, beam {y[state.BEAM]:.6g} m, "
            f"grain {y[state.GRAIN]:.6g} m, ceiling {self.height:.6g} m)"
        )
        raise NumericalFailure(self._failure)

    def _table(self, begin: float, end: float, target: float, speed: float) -> Array:
        way = abs(target - self.height)
        points = [(begin, self.height)]
        if speed > 0.0 and way >= _ARRIVED:
            # a travel too quick for the clock takes the shortest time there is
            arrival = begin + max(way / speed, math.ulp(end))
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


def _height_at(table: Array, t: float) -> float:
    row = table[max(0, int(np.searchsorted(table[:, drive.START], t, side="right")) - 1)]
    return float(row[drive.HEIGHT] + row[drive.HEIGHT_RATE] * (t - row[drive.START]))


_NO_LOG = np.zeros((0, state.COLUMNS))
