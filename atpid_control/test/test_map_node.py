# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The map action over real DDS: progress, the file, cancel and resume, refusals in one line."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from atpid_interfaces.action import ComputeMap
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.node import Node

from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.map_server import MapServer, summary_of
from atpid_sim.maps import HeightMap

SCENE = str(Path(__file__).parents[2] / "scenes" / "standard.yaml")


class Stand:
    """A node that serves maps and a client, on one executor."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.nodes = [Node(name, context=self.context) for name in ("selector_node", "client")]
        self.server = MapServer(self.nodes[0])
        self.client = ActionClient(self.nodes[1], ComputeMap, "selector_node/compute_map")
        for node in self.nodes:
            self.executor.add_node(node)
        self.feedback: list[Any] = []

    def wait(self, future: Any) -> Any:
        end = time.monotonic() + 100.0
        while not future.done():
            assert time.monotonic() < end, "the answer waited for did not come"
            self.executor.spin_once(timeout_sec=0.02)
        return future.result()

    def ask(self, out: Path, amplitudes: list[float], scene: str = SCENE, ratios: tuple[float, ...] = ()) -> Any:
        assert self.client.wait_for_server(timeout_sec=100.0)
        goal = ComputeMap.Goal(scene=scene, amplitudes=amplitudes, mass_fractions=[0.1], out=str(out))
        goal.frequency_ratios = ratios
        return self.wait(self.client.send_goal_async(goal, lambda message: self.feedback.append(message.feedback)))

    def close(self) -> None:
        self.server.close()
        for node in self.nodes:
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_a_map_is_made_with_progress(stand: Stand, tmp_path: Path) -> None:
    answer = stand.wait(stand.ask(tmp_path / "made.npz", [0.01, 0.012, 0.014]).get_result_async())
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.success
    assert HeightMap.load(tmp_path / "made.npz").lookup(0.012, 0.1).height == pytest.approx(0.235, abs=0.03)
    assert stand.feedback
    assert all(message.total == 3 for message in stand.feedback)


def test_points_that_are_missing_or_of_no_use_are_no_best_heights(stand: Stand, tmp_path: Path) -> None:
    answer = stand.wait(stand.ask(tmp_path / "made.npz", [0.01, 0.5]).get_result_async())
    assert answer.result.success
    made = HeightMap.load(tmp_path / "made.npz")
    (missing,) = made.failures
    computed = "made.npz: 1 best heights; 1 of 2 points could not be computed, the first: 0.5 m, mass fraction 0.1: "
    assert answer.result.message.endswith(f"{computed}{missing.reason}")
    useless = replace(made, efficiencies=-made.efficiencies, reproducible=np.zeros_like(made.reproducible), failures=())
    assert summary_of(useless, "made.npz") == (
        "made.npz: 2 best heights, 2 of them not reproducible, 1 of them without effect (efficiency not above 0)"
    )


def test_a_map_over_frequencies_is_made(stand: Stand, tmp_path: Path) -> None:
    asked = stand.ask(tmp_path / "made.npz", [0.01, 0.012], ratios=(0.55, 1.0))
    answer = stand.wait(asked.get_result_async())
    assert answer.result.success, answer.result.message
    assert all(message.total == 4 for message in stand.feedback)
    made = HeightMap.load(tmp_path / "made.npz")
    assert made.frequency_ratios is not None
    assert made.frequency_ratios.tolist() == [0.55, 1.0]
    assert made.lookup(0.012, 0.1, 1.0).height == pytest.approx(0.235, abs=0.03)
    assert made.lookup(0.012, 0.1, 0.55).height == pytest.approx(0.017, abs=1e-6)  # the grain is not lifted


@pytest.mark.parametrize(
    ("ratios", "words"),
    [
        ((0.4, 1.0), "frequency ratios: given 0.4; allowed: rising numbers from 0.5 to 2, or none"),
        ((1.0, float("nan")), "frequency ratios: given nan; allowed: "),
        ((1.1, 1.0), "frequency ratios: given 1.1, 1; allowed are at least 2 rising numbers"),
        ((1.0,), "frequency ratios: given 1; allowed are at least 2 rising numbers"),
    ],
)
def test_impossible_frequencies_are_refused_in_one_line(
    stand: Stand, tmp_path: Path, ratios: tuple[float, ...], words: str
) -> None:
    answer = stand.wait(stand.ask(tmp_path / "map.npz", [0.01, 0.02], ratios=ratios).get_result_async())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert words in answer.result.message
    assert "\n" not in answer.result.message
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_cancelled_map_is_kept_and_goes_on(stand: Stand, tmp_path: Path) -> None:
    amplitudes = [0.01 + 0.00005 * k for k in range(400)]
    goal = stand.ask(tmp_path / "map.npz", amplitudes)
    while not any(message.done for message in stand.feedback):
        stand.executor.spin_once(timeout_sec=0.02)
    stand.wait(goal.cancel_goal_async())
    answer = stand.wait(goal.get_result_async())
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert not answer.result.success
    assert "goes on from there" in answer.result.message
    assert not (tmp_path / "map.npz").exists()
    assert list(tmp_path.iterdir())


@pytest.mark.slow
def test_bad_input_is_answered_in_one_line(stand: Stand, tmp_path: Path) -> None:
    answer = stand.wait(stand.ask(tmp_path / "map.npz", [0.02, 0.01]).get_result_async())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "rising" in answer.result.message
    assert "\n" not in answer.result.message
    answer = stand.wait(stand.ask(tmp_path / "map.npz", [0.01, 0.02], "nowhere.yaml").get_result_async())
    assert "nowhere.yaml" in answer.result.message


@pytest.mark.slow
def test_a_second_map_is_aborted_with_the_reason(stand: Stand, tmp_path: Path) -> None:
    amplitudes = [0.01 + 0.00005 * k for k in range(400)]
    first = stand.ask(tmp_path / "first.npz", amplitudes)
    while not any(message.done for message in stand.feedback):
        stand.executor.spin_once(timeout_sec=0.02)
    answer = stand.wait(stand.ask(tmp_path / "second.npz", amplitudes).get_result_async())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "another map is being computed" in answer.result.message
    stand.wait(first.cancel_goal_async())
    assert stand.wait(first.get_result_async()).status == GoalStatus.STATUS_CANCELED


@pytest.mark.slow
def test_a_defect_is_the_result_s_message_and_the_node_goes_on(
    stand: Stand, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def defective(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr("atpid_control.nodes.map_server.build_map", defective)
    answer = stand.wait(stand.ask(tmp_path / "map.npz", [0.01, 0.02]).get_result_async())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert answer.result.message == "internal error: ZeroDivisionError: a defect"
    monkeypatch.undo()
    assert stand.wait(stand.ask(tmp_path / "map.npz", [0.01, 0.012]).get_result_async()).result.success
