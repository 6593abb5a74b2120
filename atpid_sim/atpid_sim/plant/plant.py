# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant as a stream: advanced block by block while a controller moves the ceiling."""

import math
from dataclasses import dataclass
from operator import index

import numpy as np

from atpid_common.errors import InputError
from atpid_sim.engine import columns, drive
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.plant.stream import samples_before
from atpid_sim.scene import Scene
from atpid_sim.simulation.energy import contact_energy, stored_energy
from atpid_sim.simulation.excitation import CommandedMotion, amplitude_at, frequency_at, support_rows
from atpid_sim.simulation.fidelity import choose
from atpid_sim.simulation.integration import FIDELITIES, Integration, Observation, is_closed, sample_series
from atpid_sim.system import Array

#: Closer to its target than this [m] the ceiling has arrived.
_ARRIVED = 1e-12


class PlantError(InputError):
    """An argument a plant does not accept: what was given and what is allowed. The plant is unchanged."""


@dataclass(frozen=True)
class PlantBlock:
    """One block: series (n,) at the block's sample instants, and the ledger since the start."""

    time: Array  # [s]
    support: Array  # displacement [m], or the force that drives instead [N]
    beam: Array  # displacement [m]
    beam_velocity: Array  # [m/s]
    beam_acceleration: Array  # [m/s^2]
    grain: Array  # displacement [m]
    ceiling: Array  # height above the floor [m]
    impacts: int  # since the start
    input_energy: float  # work of support or force since the start [J]
    beam_loss: float  # [J]
    contact_loss: float  # [J]
    ceiling_work: float  # [J]
    stored_energy: float  # relative to the start [J]
    excitation_amplitude: float  # at the end of the block [m], of a force [N]
    excitation_frequency: float  # at the end of the block [Hz]
    outcome: Outcome


class Plant:
    """A beam with its damper, from rest; `advance` moves it on by a whole number of samples.

    Time is an integer count of ticks times the tick, never a sum of steps.
    """

    def __init__(self, scene: Scene, fidelity: str = "auto") -> None:
        """Start at rest at time zero; `auto` is the cheapest fidelity with an open ceiling that meets the tolerance.

        Raises PlantError for an unknown fidelity, and for simplified, which has no impacts, where the scene's ceiling
        is not closed throughout; ValueError for soft and a law without force.
        """
        self._scene = scene
        if fidelity not in ("auto", *FIDELITIES):
            raise PlantError(f"fidelity {fidelity!r}: allowed are auto, {', '.join(FIDELITIES)}")
        self.integration = Integration(scene, choose(scene, fidelity, stays_closed=False).fidelity)
        self._closed_only = fidelity == "simplified"
        if self._closed_only and not is_closed(scene):
            raise PlantError(self._opened(max(height for _, height in scene.ceiling.heights)))
        self._motion = CommandedMotion() if scene.excitation.is_commanded else None
        self._rows = drive.still_rows(scene.duration) if self._motion else support_rows(scene)
        self._state = self.integration.initial_state()
        support = drive.support_displacement(self._rows, 0.0)
        self._energy_at_start = stored_energy(self.integration.system, self._state, support)
        self._ticks = 0
        self._rate: float | None = None  # [Hz], that of the first advance
        self._failure = ""  # why the integration stopped
        self.height = float(scene.ceiling.heights[0][1])

    @property
    def time(self) -> float:
        """Time reached [s]."""
        return self._state.time

    def excite(self, amplitude: float, frequency: float) -> None:
        """Let a commanded excitation go to `amplitude` [m, N] and `frequency` [Hz] by the end of the next advance.

        Raises PlantError for others, and where the scene's excitation is not commanded.
        """
        if self._motion is None:
            raise PlantError("excitation: given a command; allowed: with a scene of excitation.commanded: true")
        if not (0.0 <= amplitude < math.inf and 0.0 <= frequency < math.inf):
            raise PlantError(f"excitation: given {amplitude:g} at {frequency:g} Hz; allowed: finite and not negative")
        self._motion.goal = amplitude, frequency

    def advance(self, duration_ticks: int, rate: float, target: float, speed: float) -> PlantBlock:
        """Advance by `duration_ticks` samples at `rate` [Hz], the ceiling going toward `target` [m] at `speed` [m/s].

        A speed of 0 holds it. Samples are at the start of the run plus i / rate, all before the end of the scene; the
        last block may end up to a tick later than the scene.

        Raises PlantError, and changes nothing, for arguments that are negative or not finite, another rate than before,
        samples beyond the scene's end, and a simplified plant that is to open. Raises NumericalFailure with time and
        state where the motion cannot be followed: the block up to there is lost, `time` and `height` are where it
        stopped, and every further advance raises NumericalFailure with the same reason.
        """
        duration_ticks, rate, target, speed = self._checked(duration_ticks, rate, target, speed)
        if self._failure:
            raise NumericalFailure(f"the plant cannot go on, make a new one: {self._failure}")
        begin, end = self._ticks / rate, (self._ticks + duration_ticks) / rate
        if self._motion is not None:
            self._rows = self._motion.rows(begin, end)
        table = self._table(begin, end, target, speed)
        out = sample_series(duration_ticks)
        self._state.n[columns.SAMPLE] = 0
        self._state.restart_steps()
        outcome = self.integration.advance(self._state, table, Observation((end, end), begin, 1.0 / rate, out))
        self._rate = rate
        if outcome != Outcome.DONE:
            self._fail(outcome, table)
        self._ticks += duration_ticks
        self.height = drive.height_in(table[-1], table[-1, columns.END])
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
        length = self._scene.duration if self._motion else float(self._rows[-1, columns.END])
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
            f"({2.0 * self.integration.system.radius:g} m); use fidelity soft or impact"
        )

    def _fail(self, outcome: Outcome, table: Array) -> None:
        """Raise NumericalFailure with time and state, at this and every later call."""
        state = self._state
        self.height = drive.ceiling_height(table, state.time)
        self._failure = (
            f"{outcome.sentence} (at {state.time:.6f} s, beam {state.beam:.6g} m, "
            f"grain {state.grain:.6g} m, ceiling {self.height:.6g} m)"
        )
        raise NumericalFailure(self._failure)

    def _table(self, begin: float, end: float, target: float, speed: float) -> Array:
        distance = abs(target - self.height)
        points = [(begin, self.height)]
        if speed > 0.0 and distance >= _ARRIVED:
            # a travel below the clock's resolution takes the shortest time there is
            arrival = begin + max(distance / speed, math.ulp(end))
            share = min(1.0, (end - begin) / (arrival - begin))
            points.append((min(arrival, end), self.height + share * (target - self.height)))
        return drive.with_ceiling(drive.between(self._rows, begin, end), points)

    def _block(self, begin: float, end: float, rate: float, table: Array, out: Array, outcome: Outcome) -> PlantBlock:
        state, y, motion = self._state, self._state.y, self._motion
        stored = stored_energy(self.integration.system, state, drive.support_displacement(self._rows, end))
        stored += contact_energy(self.integration.contact, self.integration.system, state, table)
        return PlantBlock(
            time=begin + np.arange(out.shape[1]) / rate,
            support=out[columns.S_SUPPORT],
            beam=out[columns.S_BEAM],
            beam_velocity=out[columns.S_VELOCITY],
            beam_acceleration=out[columns.S_ACCELERATION],
            grain=out[columns.S_GRAIN],
            ceiling=out[columns.S_CEILING],
            impacts=state.floor_impacts + state.ceiling_impacts,
            input_energy=float(y[columns.INPUT]),
            beam_loss=float(y[columns.BEAM_LOSS]),
            contact_loss=float(y[columns.CONTACT_LOSS]),
            ceiling_work=float(y[columns.CEILING_WORK]),
            stored_energy=stored - self._energy_at_start,
            excitation_amplitude=motion.amplitude if motion else amplitude_at(self._scene, end),
            excitation_frequency=motion.frequency if motion else frequency_at(self._scene, end),
            outcome=outcome,
        )
