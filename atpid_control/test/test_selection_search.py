# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The step search: its steps, how it takes the ceiling in the control loop and gives it back, and its action."""

import array
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from atpid_interfaces.action import SearchHeight
from atpid_interfaces.msg import SampleBlock
from hypothesis import given
from hypothesis import strategies as st
from rclpy.action import ActionClient
from spun import Spun
from test_controller_computing import settings

from atpid_common.nodes.messages import BLOCKS, time_of
from atpid_common.testing import PATIENCE
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.controller import SelectingController
from atpid_control.loop.protocol import HeightCommand
from atpid_control.loop.search_run import SearchRun
from atpid_control.nodes.action_servers import SearchServer
from atpid_control.selection.protocol import Excitation, Selection
from atpid_control.selection.search import Plan, SearchError, SearchSelector, StepSearch
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import load_scene
from atpid_sim.system import Array

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
STEADY = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.49)
PLAN = Plan(0.1, 2.0, 0.1, 0.9)


# the steps


def walk(plan: Plan, amplitude_at: Callable[[float], float]) -> StepSearch:
    search = StepSearch(plan)
    while not search.done:
        search.observe(amplitude_at(search.target))
    return search


def test_it_goes_back_when_it_gets_worse_and_ends_at_the_highest_height_where_that_is_best() -> None:
    search = walk(Plan(0.1, 3.0, 0.1, 1.0), lambda height: abs(height - 0.52))
    assert search.target == search.best_height == pytest.approx(0.5)
    assert search.iterations == 6
    search = walk(Plan(0.3, 3.0, 0.1, 1.0), lambda height: 2.0 - height)
    assert search.target == 1.0
    assert search.observe(5.0) == 1.0


@given(best=st.floats(0.05, 2.0), step=st.floats(0.01, 0.3))
def test_it_always_ends_within_a_step_of_a_single_minimum(best: float, step: float) -> None:
    search = walk(Plan(step, 1.0, 0.05, 2.0), lambda height: abs(height - best))
    assert abs(search.target - best) <= step + 1e-9
    assert 0.05 <= search.target <= 2.0


@pytest.mark.parametrize(
    ("name", "value"), [("step", 0.0), ("step", math.nan), ("dwell", 0.0), ("lowest", 1.0), ("lowest", math.nan)]
)
def test_impossible_plans_are_refused(name: str, value: float) -> None:
    with pytest.raises(SearchError, match=f"^{name.replace('lowest', 'limits')}: given {value:g}"):
        Plan(**({"step": 0.1, "dwell": 3.0, "lowest": 0.1, "highest": 0.9} | {name: value}))


def test_with_the_thesis_s_own_steps_it_finds_the_thesis_s_height() -> None:
    # a tenth of a metre every 4 s, opened in 1 s
    chosen = SearchSelector(STANDARD, Plan(0.1, 3.0, 0.1, 1.5)).select(Excitation(0.03))
    assert chosen.height == pytest.approx(0.6, abs=0.11)
    assert [stage.name for stage in chosen.stages][:2] == ["step 1", "step 2"]
    assert "back" in chosen.stages[-2].note


# in the control loop


@dataclass
class Proportional:
    """A method that selects ten times the amplitude."""

    method: str = "lookup"
    simulates: bool = False

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        return Selection(10.0 * excitation.amplitude, math.nan, math.nan, self.method)


def controller(limits: tuple[float, float]) -> SelectingController:
    """Return one that has selected a height, 0.3 m."""
    made = SelectingController(settings(), Proportional(), limits)
    for _ in range(10):
        made.answer(0.0, STEADY, 0.3)
    return made


class Loop:
    """The bench in small: a ceiling of constant speed, and a beam whose amplitude is least at 0.52 m."""

    def __init__(self, limits: tuple[float, float] = (0.017, 1.0)) -> None:
        self.controller = controller(limits)
        self.search = self.controller.search
        self.show: Callable[[float, Array], None] = self.search.watch
        self.height, self.time, self.excitation = 0.3, 0.0, 0.03
        self.amplitude: Callable[[float], float] = lambda height: abs(height - 0.52) + 0.1
        self.commands: list[HeightCommand] = []

    def turn(self) -> HeightCommand:
        """One round: a block of the beam, an answered estimate, a ceiling that moves on."""
        self.time += 0.05
        phase = 2.0 * math.pi * 5.5 * (self.time + np.arange(-50, 0) * 1e-3)
        self.show(self.time, self.amplitude(self.height) * np.sin(phase))
        estimate = replace(STEADY, amplitude=self.excitation)
        command = self.controller.answer(self.time, estimate, self.height).command
        if math.isfinite(command.height):  # else another method was chosen, and has selected none
            self.height += float(np.clip(command.height - self.height, -0.015, 0.015))
        self.commands.append(command)
        return command

    def turns(self, count: int) -> list[HeightCommand]:
        return [self.turn() for _ in range(count)]

    def searched(self) -> SearchRun:
        """Return a search when it has ended."""
        run = self.search.begin(PLAN)
        while not run.done:
            self.turn()
            assert self.time < 600.0, "the search does not end"
        return run


@pytest.fixture
def loop() -> Loop:
    return Loop()


def test_it_finds_the_height_and_keeps_it_with_rising_sequence_numbers(loop: Loop) -> None:
    assert loop.turn().height == pytest.approx(0.3)
    run = loop.searched()
    assert run.success
    assert run.search.best_height == pytest.approx(0.5)
    assert run.search.iterations == 6
    last = loop.turns(100)[-1]
    assert (last.height, loop.height) == pytest.approx((0.5, 0.5))
    assert last.method == "search"
    assert all(b.sequence == a.sequence + (a.height != b.height) for a, b in pairwise(loop.commands))


def test_a_changed_excitation_ends_it(loop: Loop) -> None:
    run = loop.search.begin(PLAN)
    loop.turns(60)
    loop.excitation = 0.07
    before = loop.commands[-1]
    assert before.method == "search"
    command = loop.turns(60)[-1]
    assert (run.done, run.success) == (True, False)
    assert "excitation" in run.message
    assert command.height == pytest.approx(0.7)
    assert command.sequence > before.sequence


def test_a_beam_that_is_not_seen_or_a_ceiling_that_does_not_come_ends_it(loop: Loop) -> None:
    loop.amplitude = lambda _: math.nan
    unseen, unmoved = loop.searched(), SearchRun(PLAN)
    for time in np.arange(0.0, 70.0, 0.5):
        unmoved.step(float(time), 0.5)
    assert (unseen.success, unmoved.success) == (False, False)
    assert re.match(r"amplitude: .*\bnan\b", unseen.message)
    assert re.findall(r"[\d.]+(?= m)", unmoved.message) == ["0.1", "0.5"]


def test_rumble_met_while_searching_is_not_passed_on(loop: Loop) -> None:
    run = loop.search.begin(PLAN)
    assert loop.search.crosses("rumble")
    assert not loop.search.crosses("calm")
    run.stop("cancelled")
    assert not loop.search.crosses("rumble")


@pytest.mark.parametrize(("start", "step", "dwell"), [(0.017, 0.02, 2.0), (0.57, 0.05, 1.0), (0.57, 0.02, 2.0)])
def test_on_the_plant_it_finds_the_best_height_from_anywhere(start: float, step: float, dwell: float) -> None:
    # from 0.57 m down to 0.3 m the beam grows for seconds: measured too early, the first height looks better
    plant = Plant(STANDARD.with_(amplitude=0.03, height=start, duration=200.0))
    plant.advance(8000, 1000.0, start, 0.0)
    steering = controller((0.017, 1.0))
    run = steering.search.begin(Plan(step, dwell, 0.3, 0.7))
    target, time = math.nan, 8.0
    while not run.done:
        block = plant.advance(50, 1000.0, target if math.isfinite(target) else plant.height, 0.3)
        time += 0.05
        assert time < 400.0, "the search does not end"
        steering.search.watch(time, block.beam)
        target = steering.answer(time, STEADY, plant.height).command.height
    assert run.success
    assert 0.54 <= target <= 0.60
    assert run.search.best_amplitude < 0.135


def test_another_method_goes_on_with_the_numbers_and_ends_a_search() -> None:
    loop = Loop((0.1, 2.0))
    loop.turn()
    run = loop.search.begin(PLAN)
    searched = loop.turns(2)[-1]
    loop.controller.select_by(settings(), Proportional("pca"))
    assert (run.done, run.success) == (True, False)
    before = loop.controller.answer(loop.time, STEADY, loop.height).command
    assert (before.method, math.isnan(before.height)) == ("pca", True)  # the ceiling stays until it has selected
    assert before.sequence >= searched.sequence
    selected = loop.turns(10)[-1]
    assert selected.method == "pca"
    assert selected.height == pytest.approx(0.3)
    assert selected.sequence > before.sequence


# the action

START = 1_700_000_000_000_000_000  # stamp of the first sample [ns]
GOAL = {"step": 0.1, "dwell": 2.0, "lowest": 0.1, "highest": 0.9}


class Stand(Spun):
    """A selector in small and a client; the search sees the loop's beam by a topic."""

    def __init__(self) -> None:
        super().__init__("selector_node", "client")
        self.loop, self.seen = Loop(), 0.0
        self.server = SearchServer(self.node, self.loop.search, lambda: START)
        self.actions = ActionClient(self.peer, SearchHeight, "selector_node/search")
        self.blocks = self.peer.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        self.loop.show, watch = self.show, self.loop.search.watch

        def watched(time: float, beam: Array) -> None:
            self.seen = time
            watch(time, beam)

        self.loop.search.watch = watched  # type: ignore[method-assign]

    def show(self, time: float, beam: Array) -> None:
        """Publish a block to a running search and wait until it has been seen."""
        if self.loop.search.run is None or self.loop.search.run.done:
            return
        message = SampleBlock(rate=1000.0, channels=["support_displacement", "beam_displacement"])
        message.header.stamp = time_of(START + round((time - 0.05) * 1e9))
        message.data = array.array("d", np.stack([0.0 * beam, beam], axis=1).ravel().tolist())
        self.until(self.blocks.get_subscription_count)
        self.blocks.publish(message)
        self.until(lambda: self.seen >= time - 1e-6)

    def turn(self) -> None:
        self.loop.turn()
        self.server.report()

    def ten_turns(self) -> None:
        for _ in range(10):
            self.turn()

    def search(self, **changes: float) -> tuple[Any, list[SearchHeight.Feedback]]:
        """Return an accepted goal, and the feedback as it comes."""
        assert self.actions.wait_for_server(timeout_sec=PATIENCE)
        heard: list[SearchHeight.Feedback] = []
        goal = self.wait(
            self.actions.send_goal_async(
                SearchHeight.Goal(**(GOAL | changes)), feedback_callback=lambda message: heard.append(message.feedback)
            )
        )
        assert goal.accepted
        return goal, heard

    def result(self, goal: Any, act: Callable[[], None] = lambda: None) -> tuple[int, SearchHeight.Result]:
        answer = self.wait(goal.get_result_async(), act)
        assert answer.result.success == (answer.status == GoalStatus.STATUS_SUCCEEDED)
        return answer.status, answer.result

    def close(self) -> None:
        self.server.close()
        self.actions.destroy()
        super().close()


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_a_search_can_be_cancelled_and_another_begun(stand: Stand) -> None:
    goal, heard = stand.search()
    stand.until(lambda: len(heard) >= 3, stand.turn)
    goal.cancel_goal_async()
    status, result = stand.result(goal, stand.turn)
    assert status == GoalStatus.STATUS_CANCELED
    assert re.findall(r"[\d.]+", result.message) == ["2", "0.2000"]
    assert result.height == pytest.approx(0.2)
    here = stand.loop.height
    assert {command.reason for command in stand.loop.turns(20)} == {"cancelled"}
    assert stand.loop.height == pytest.approx(here, abs=1e-9)
    stand.search()


def test_a_search_is_cancelled_also_where_no_estimates_come(stand: Stand) -> None:
    goal, _ = stand.search()
    goal.cancel_goal_async()
    status, result = stand.result(goal)
    assert (status, result.message) == (GoalStatus.STATUS_CANCELED, "cancelled")
    assert math.isnan(result.height)


def test_a_goal_that_cannot_be_searched_is_aborted_with_the_reason(stand: Stand) -> None:
    changes: list[tuple[dict[str, float], str]] = [
        ({"highest": 2.0}, r"limits: .* 0\.1 to 2 m; .* 0\.017 to 1 m"),
        ({"step": -0.1}, r"step: .* -0\.1 m; .* 0"),
        ({"dwell": 0.5}, r"dwell: .* 0\.5 s; .* 1 s"),
        ({"lowest": math.nan}, r"limits: .* nan to 0\.9 m; .* 0"),
    ]
    for change, line in changes:
        status, result = stand.result(stand.search(**change)[0])
        assert status == GoalStatus.STATUS_ABORTED
        assert re.fullmatch(line, result.message)
    stand.loop.turns(200)  # it begins long after the run
    first, heard = stand.search()
    status, result = stand.result(stand.search()[0])  # a second one, and the first goes on
    assert (status, "running" in result.message) == (GoalStatus.STATUS_ABORTED, True)
    status, result = stand.result(first, stand.ten_turns)
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert result.height == pytest.approx(0.5)
    assert heard[-1].iteration == result.iterations == 6
