# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The search in the control loop: it takes the ceiling, finds the height on a plant, and gives the ceiling back."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_control.identification import Estimate, Quality
from atpid_control.loop.protocol import ControlSettings, HeightCommand, LoopAnswer
from atpid_control.loop.search_run import SearchingController, SearchRun
from atpid_control.selection.search import Plan, SearchError
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import load_scene

SCENES = Path(__file__).parents[2] / "scenes"
STEADY = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.49)
PLAN = Plan(0.1, 2.0, 0.1, 0.9)


@dataclass
class Inner:
    """A controller that has selected a height."""

    command: HeightCommand = field(default_factory=lambda: HeightCommand(sequence=4, height=0.3, method="lookup"))
    heard: list[str] = field(default_factory=list)

    def configure(self, settings: ControlSettings) -> None:
        raise AssertionError(settings)

    def answer(self, time: float, estimate: Estimate, height: float) -> LoopAnswer:
        del time, estimate, height
        return LoopAnswer(self.command)

    def on_event(self, kind: str) -> None:
        self.heard.append(kind)


@dataclass
class Loop:
    """The bench in small: a ceiling of constant speed, and a beam whose amplitude depends on the height."""

    controller: SearchingController
    height: float = 0.3
    time: float = 0.0
    amplitude: Callable[[float], float] = lambda height: abs(height - 0.52) + 0.1
    commands: list[HeightCommand] = field(default_factory=list)

    def turn(self) -> HeightCommand:
        self.time += 0.05
        phase = 2.0 * math.pi * 5.5 * (self.time + np.arange(-50, 0) * 1e-3)
        self.controller.watch(self.time, self.amplitude(self.height) * np.sin(phase))
        command = self.controller.answer(self.time, STEADY, self.height).command
        self.height += float(np.clip(command.height - self.height, -0.015, 0.015))
        self.commands.append(command)
        return command

    def until_done(self) -> SearchRun:
        run = self.controller.run
        while run is not None and not run.done:
            self.turn()
        assert run is not None
        return run


@pytest.fixture
def loop() -> Loop:
    return Loop(SearchingController(Inner(), (0.017, 1.0)))


def test_without_a_search_the_controller_goes_through(loop: Loop) -> None:
    assert loop.turn() == loop.controller._inner.command  # type: ignore[attr-defined]


def test_it_finds_the_height_and_keeps_it(loop: Loop) -> None:
    loop.controller.begin(PLAN)
    run = loop.until_done()
    assert run.success
    assert run.search.best_height == pytest.approx(0.5)
    assert run.search.iterations == 6
    for _ in range(100):
        last = loop.turn()
    assert last.height == pytest.approx(0.5)
    assert last.method == "search"
    assert loop.height == pytest.approx(0.5)


def test_sequence_numbers_rise_with_every_new_height(loop: Loop) -> None:
    loop.turn()
    loop.controller.begin(PLAN)
    loop.until_done()
    loop.turn()
    pairs = [(a, b) for a, b in zip(loop.commands[:-1], loop.commands[1:], strict=True)]
    assert all(b.sequence == a.sequence + (a.height != b.height) for a, b in pairs)


def test_a_changed_excitation_ends_it(loop: Loop) -> None:
    run = loop.controller.begin(PLAN)
    for _ in range(60):
        loop.turn()
    inner: Any = loop.controller._inner
    inner.command = replace(inner.command, sequence=5, height=0.7)
    command = loop.turn()
    assert run.done
    assert not run.success
    assert "excitation changed" in run.message
    assert command.height == 0.7
    assert command.sequence > loop.commands[-2].sequence


def test_cancelled_the_ceiling_stays_where_it_is(loop: Loop) -> None:
    run = loop.controller.begin(PLAN)
    for _ in range(200):
        loop.turn()
    run.stop("cancelled")
    here = loop.height
    heights = [loop.turn().height for _ in range(20)]
    assert heights == [here] * 20
    assert loop.turn().reason == "cancelled"


def test_a_beam_that_is_not_seen_ends_it(loop: Loop) -> None:
    loop.amplitude = lambda _: math.nan
    loop.controller.begin(PLAN)
    run = loop.until_done()
    assert not run.success
    assert "is not measured" in run.message


def test_a_ceiling_that_does_not_come_ends_it() -> None:
    run = SearchRun(PLAN)
    for time in np.arange(0.0, 70.0, 0.5):
        run.step(float(time), 0.5)
    assert "has not reached 0.1 m" in run.message


def test_rumble_met_while_searching_is_not_passed_on(loop: Loop) -> None:
    loop.controller.begin(PLAN)
    loop.controller.on_event("rumble")
    loop.until_done()
    loop.controller.on_event("rumble")
    assert loop.controller._inner.heard == ["rumble"]  # type: ignore[attr-defined]


def test_one_search_at_a_time_and_within_the_range(loop: Loop) -> None:
    with pytest.raises(SearchError, match=r"allowed is the ceiling's 0\.017 to 1 m"):
        loop.controller.begin(Plan(0.1, 2.0, 0.1, 1.5))
    with pytest.raises(SearchError, match="dwell"):
        loop.controller.begin(Plan(0.1, 0.5, 0.1, 0.9))
    loop.controller.begin(PLAN)
    with pytest.raises(SearchError, match="is running"):
        loop.controller.begin(PLAN)


@pytest.mark.parametrize(("step", "dwell"), [(0.02, 2.0), (0.05, 1.0)])
@pytest.mark.parametrize("start", [0.017, 0.57])
def test_on_the_plant_it_finds_the_best_height_from_anywhere(start: float, step: float, dwell: float) -> None:
    # from 0.57 m down to 0.3 m the beam grows for seconds: measured too early, the first height looks better
    scene = load_scene(SCENES / "standard.yaml").with_(amplitude=0.03, height=start, duration=200.0)
    plant = Plant(scene)
    plant.advance(8000, 1000.0, start, 0.0)
    controller = SearchingController(Inner(), (0.017, 1.0))
    run = controller.begin(Plan(step, dwell, 0.3, 0.7))
    target, time = math.nan, 8.0
    while not run.done:
        block = plant.advance(50, 1000.0, target if math.isfinite(target) else plant.height, 0.3)
        time += 0.05
        controller.watch(time, block.beam)
        target = controller.answer(time, STEADY, plant.height).command.height
    assert run.success
    assert 0.54 <= target <= 0.60
    assert run.search.best_amplitude < 0.135


def test_another_controller_goes_on_with_the_numbers_and_ends_a_search() -> None:
    loop = Loop(SearchingController(Inner(), (0.1, 2.0)))
    loop.turn()
    run = loop.controller.begin(PLAN)
    loop.turn()
    searched = loop.turn()
    loop.controller.select_by(Inner(HeightCommand(sequence=0, method="pca", reason="no estimate yet")))
    assert (run.done, run.success, run.message) == (True, False, "another method was chosen")
    before = loop.controller.answer(loop.time, STEADY, loop.height).command
    assert (before.method, math.isnan(before.height)) == ("pca", True)  # the ceiling stays until it has selected
    assert before.sequence >= searched.sequence
    loop.controller.select_by(Inner(HeightCommand(sequence=1, height=0.5, method="direct")))
    assert loop.turn().sequence > before.sequence
