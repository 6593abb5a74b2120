# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search on the running damper (thesis section 4.2): step the ceiling up, observe, return when the amplitude grows."""

import math
import time
from dataclasses import dataclass

from atpid_common.errors import InputError
from atpid_control.selection.protocol import Excitation, Selection, SelectionError, SelectionStage
from atpid_sim.maps import DamperResponse
from atpid_sim.outcome import NumericalFailure
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency, half_peak_to_peak


class SearchError(InputError):
    """A search that cannot be made with the limits or steps given."""


@dataclass(frozen=True)
class Plan:
    """How the ceiling is stepped."""

    step: float  # change of height each time [m]
    dwell: float  # time to watch the beam after each move [s]
    lowest: float  # [m]
    highest: float  # [m]

    def __post_init__(self) -> None:
        if not (self.step > 0.0 and math.isfinite(self.step)):
            raise SearchError(f"step: given {self.step:g} m; allowed is a number above 0")
        if not (self.dwell > 0.0 and math.isfinite(self.dwell)):
            raise SearchError(f"dwell: given {self.dwell:g} s; allowed is a time above 0")
        if not 0.0 < self.lowest < self.highest < math.inf:
            limits = f"{self.lowest:g} to {self.highest:g} m"
            raise SearchError(f"limits: given {limits}; allowed are two rising heights above 0")


class StepSearch:
    """The thesis's algorithm as a state machine: `target` is the next height, `observe` takes the amplitude there."""

    def __init__(self, plan: Plan, worse: float = 0.0) -> None:
        """Begin at the plan's lowest height; `worse` is how much a larger amplitude must exceed the least [-]."""
        self._plan, self._worse = plan, worse
        self.target = plan.lowest
        self.best_height, self.best_amplitude = math.nan, math.inf
        self.iterations = 0
        self.done = False

    def observe(self, amplitude: float) -> float:
        """Take the beam's settled amplitude [m] at `target`; return the next height [m]. Raises SearchError for NaN."""
        if self.done:
            return self.target
        if not (math.isfinite(amplitude) and amplitude >= 0.0):
            raise SearchError(f"amplitude: given {amplitude:g} m; the beam is not measured, so the search stops")
        self.iterations += 1
        if amplitude <= self.best_amplitude:
            self.best_height, self.best_amplitude = self.target, amplitude
        self.done = amplitude > (1.0 + self._worse) * self.best_amplitude or self.target >= self._plan.highest
        self.target = self.best_height if self.done else min(self.target + self._plan.step, self._plan.highest)
        return self.target


#: Where no plan is given: steps of a twentieth of the ballistic clearance, and the thesis's 3 s of watching at rest.
_STEPS, _DWELL, _WATCHED = 20, 3.0, 1.0
#: Rate at which the plant is watched [Hz], and the block it is advanced by [s].
_RATE = 1000.0
#: Speed of the ceiling where the scene gives none: a step in the thesis's opening time of 1 s.
_TRAVEL = 1.0


class SearchSelector:
    """The search, made on a simulated plant; `stages` of the result shows every step."""

    method, simulates = "search", True

    def __init__(self, scene: Scene, plan: Plan | None = None) -> None:
        self._scene, self._plan = scene.with_(initial=None), plan
        self._damper = DamperResponse(scene)
        self._limits = scene.height_limits
        self._speed = scene.ceiling.speed

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the height the search ends at, begun with the closed damper; see `HeightSelector.select`."""
        del height  # it begins with the closed damper, as the thesis does
        excitation.spread(margin)  # refuses a margin that is none
        amplitude = excitation.amplitude
        begun = time.perf_counter()
        plan = self._plan or self._scaled(amplitude)
        search = StepSearch(plan)
        plant = self._plant(amplitude, excitation.frequency, plan)
        stages: list[SelectionStage] = []
        try:
            while not search.done:
                here = search.target
                seen = self._watch(plant, here, plan)
                search.observe(seen)
                note = "worse: back" if search.done and search.target != here else ""
                stages.append(SelectionStage(f"step {search.iterations}", here, seen, note))
            seen = self._watch(plant, search.target, plan)
        except NumericalFailure as error:
            raise SelectionError(f"search: {error}") from error
        stages.append(SelectionStage("result", search.target, seen, f"{plant.time:.0f} s on the plant"))
        reduction = efficiency(seen, self._damper.closed_amplitude(amplitude))
        wall, price = time.perf_counter() - begun, math.nan if margin else 0.0
        found = (search.target, seen, reduction, self.method)
        return Selection(*found, search.iterations, wall, price, tuple(stages), plant.time)

    def _scaled(self, amplitude: float) -> Plan:
        step = self._damper.ballistic_clearance(amplitude) / _STEPS
        highest = min(self._limits[1], self._damper.diameter + 1.4 * _STEPS * step)
        return Plan(step, max(_DWELL, 4.0 * self._damper.decay_periods * self._damper.period), self._limits[0], highest)

    def _speed_of(self, plan: Plan) -> float:
        """Return the ceiling's speed [m/s]: the scene's, or a step in the thesis's opening time."""
        return plan.step / _TRAVEL if math.isnan(self._speed) else self._speed

    def _plant(self, amplitude: float, frequency: float, plan: Plan) -> Plant:
        steps = math.ceil((plan.highest - plan.lowest) / plan.step) + 3
        speed = self._speed_of(plan)
        travel, back = plan.step / speed, (plan.highest - plan.lowest) / speed
        changes: dict[str, float] = {} if math.isnan(frequency) else {"frequency": frequency}
        duration = steps * (travel + plan.dwell + 1.0) + back
        scene = self._scene.with_(
            amplitude=amplitude, height=plan.lowest, duration=duration, steady_window=[0.0, duration], **changes
        )
        return Plant(scene)

    def _watch(self, plant: Plant, height: float, plan: Plan) -> float:
        """Move the ceiling to a height [m], wait, and return half the beam's range in the last second of the dwell."""
        speed = self._speed_of(plan)
        travel = math.ceil(abs(height - plant.height) / speed * _RATE) + 1
        plant.advance(travel, _RATE, height, speed)
        watched = min(_WATCHED, plan.dwell)
        if plan.dwell > watched:
            plant.advance(math.ceil((plan.dwell - watched) * _RATE), _RATE, height, 0.0)
        beam = plant.advance(math.ceil(watched * _RATE), _RATE, height, 0.0).beam
        return half_peak_to_peak(beam)
