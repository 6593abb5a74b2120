# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selector's services and its map action over real DDS: answers, refusals, and a loop they do not hold up."""

import math
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from atpid_interfaces.action import ComputeMap
from atpid_interfaces.srv import SelectHeight
from rclpy.action import ActionClient
from rclpy.task import Future
from spun import Spun
from std_msgs.msg import Empty

from atpid_common.testing import PATIENCE
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.protocol import threaded
from atpid_control.nodes.action_servers import MapServer, summary_of
from atpid_control.nodes.height_services import HeightServices
from atpid_control.selection import Excitation, HeightSelector, make_selector
from atpid_control.selection.checks import Resonance
from atpid_control.selection.protocol import Selection
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene

ROOT = Path(__file__).parents[2]
SCENE = load_scene(ROOT / "scenes" / "thesis_4_3.yaml")
MAKE = partial(make_selector, scene=SCENE, height_map=ROOT / "atpid_control/config/maps/standard.npz")
STEADY = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.49)


class Stand(Spun):
    """A node with the services and a client."""

    def __init__(self, make: Callable[[str], HeightSelector] = MAKE) -> None:
        super().__init__("selector_node", "client")
        self.latest: Estimate | None = None
        self.worker = threaded("session-selection")
        HeightServices(self.node, self.worker, make, "lookup", self.situation, SCENE)

    def situation(self) -> tuple[Estimate | None, float, Resonance]:
        return self.latest, 0.3, Resonance(SCENE.frequency_hz, 0.03)

    def begin(self, method: str, **request: float) -> Future:
        service = self.peer.create_client(SelectHeight, f"selector_node/{method}")
        assert service.wait_for_service(timeout_sec=PATIENCE)
        return service.call_async(SelectHeight.Request(**request))

    def ask(self, method: str, **request: float) -> SelectHeight.Response:
        response: SelectHeight.Response = self.wait(self.begin(method, **request))
        return response

    def close(self) -> None:
        self.worker.shutdown()
        super().close()


@pytest.fixture(scope="module")
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_each_method_answers_what_it_would_choose(stand: Stand) -> None:
    for method in ("lookup", "pca", "direct"):
        answer = stand.ask(method, amplitude=0.03)
        assert (answer.success, answer.method, answer.price) == (True, method, 0.0)
        assert answer.height == pytest.approx(0.57, rel=0.06)
        assert answer.efficiency > 0.79
    given = {"amplitude": 0.03, "amplitude_std": 1e-4, "margin": 3.0}
    assert math.isnan(stand.ask("lookup", **given).price)  # which it does not compute
    answer = stand.ask("direct", **given)
    assert 0.0 < answer.price < 0.2
    assert re.findall(r"\d+ of \d+", answer.message) == ["123 of 123"]  # systems
    unknown = stand.ask("direct")
    assert (unknown.success, "estimate" in unknown.message) == (False, True)
    stand.latest = STEADY
    assert stand.ask("lookup").success
    refused = stand.ask("select", amplitude=0.03, margin=-3.0)
    assert (refused.success, math.isnan(refused.height)) == (False, True)
    assert re.search(r"^margin: given -3; .*\b0 to 100\b", refused.message)


def test_amplitudes_beyond_the_map_and_heights_beyond_the_ceiling_are_named(stand: Stand) -> None:
    assert re.search(r"5 m .*0\.002 to 0\.08 m", stand.ask("lookup", amplitude=5.0).message)
    message = stand.ask("lookup", amplitude=0.08).message
    assert re.search(r"ceiling\.range \(0\.017 to 1 m\).* 1 m$", message)


class Blocked:
    """A selector that answers when the test lets it."""

    method, simulates = "lookup", False

    def __init__(self) -> None:
        self.begun, self.proceed = threading.Event(), threading.Event()

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        self.begun.set()
        assert self.proceed.wait(PATIENCE)
        raise ZeroDivisionError("a defect")


def test_the_node_goes_on_while_a_height_is_computed_and_a_defect_is_reported() -> None:
    selector = Blocked()
    stand = Stand(lambda _method: selector)
    try:
        taken: list[Empty] = []
        stand.node.create_subscription(Empty, "loop", taken.append, 10)
        loop = stand.peer.create_publisher(Empty, "loop", 10)
        answer = stand.begin("lookup", amplitude=0.03)
        stand.until(selector.begun.is_set)
        stand.until(lambda: len(taken) >= 5, lambda: loop.publish(Empty()))
        assert not answer.done()
        selector.proceed.set()
        response = stand.wait(answer)
        assert not response.success
        assert response.message.endswith("ZeroDivisionError: a defect")
    finally:
        selector.proceed.set()
        stand.close()


# maps

STANDARD = str(ROOT / "scenes" / "standard.yaml")
#: So many points that a map of them is not done before it is cancelled.
MANY = [0.01 + 0.00005 * k for k in range(400)]


class MapStand(Spun):
    """A node that serves maps and a client."""

    def __init__(self) -> None:
        super().__init__("selector_node", "client")
        self.server = MapServer(self.node)
        self.client = ActionClient(self.peer, ComputeMap, "selector_node/compute_map")
        self.feedback: list[Any] = []

    def ask(self, out: Path, amplitudes: list[float], scene: str = STANDARD, ratios: tuple[float, ...] = ()) -> Any:
        assert self.client.wait_for_server(timeout_sec=PATIENCE)
        goal = ComputeMap.Goal(scene=scene, amplitudes=amplitudes, mass_fractions=[0.1], out=str(out))
        goal.frequency_ratios = ratios
        self.feedback.clear()
        return self.wait(self.client.send_goal_async(goal, lambda message: self.feedback.append(message.feedback)))

    def answer(self, goal: Any) -> tuple[int, Any]:
        """Return how a goal ended, and its result; one that did not succeed has one line."""
        answer = self.wait(goal.get_result_async())
        assert answer.result.success == (answer.status == GoalStatus.STATUS_SUCCEEDED)
        assert "\n" not in answer.result.message
        return answer.status, answer.result

    def close(self) -> None:
        self.server.close()
        super().close()


@pytest.fixture
def maps() -> Iterator[MapStand]:
    made = MapStand()
    yield made
    made.close()


def test_points_that_are_missing_or_of_no_use_are_no_best_heights(maps: MapStand, tmp_path: Path) -> None:
    status, result = maps.answer(maps.ask(tmp_path / "made.npz", [0.01, 0.5]))
    assert status == GoalStatus.STATUS_SUCCEEDED
    made = HeightMap.load(tmp_path / "made.npz")
    (missing,) = made.failures
    assert result.message.endswith(missing.reason)
    assert re.findall(r"[\d.]+", result.message.partition("made.npz: ")[2])[:5] == ["1", "1", "2", "0.5", "0.1"]
    useless = replace(made, efficiencies=-made.efficiencies, reproducible=np.zeros_like(made.reproducible), failures=())
    assert re.findall(r"\d+", summary_of(useless, "made.npz")) == ["2", "2", "1", "0"]


def test_a_map_over_frequencies_is_made_with_progress(maps: MapStand, tmp_path: Path) -> None:
    status, result = maps.answer(maps.ask(tmp_path / "made.npz", [0.01, 0.012], ratios=(0.55, 1.0)))
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert {message.total for message in maps.feedback} == {4}
    made = HeightMap.load(tmp_path / "made.npz")
    assert made.frequency_ratios is not None
    assert made.frequency_ratios.tolist() == [0.55, 1.0]
    assert made.lookup(0.012, 0.1, 1.0).height == pytest.approx(0.235, abs=0.03)
    assert made.lookup(0.012, 0.1, 0.55).height == pytest.approx(0.017, abs=1e-6)  # the grain is not lifted


def test_bad_input_is_answered_in_one_line(maps: MapStand, tmp_path: Path) -> None:
    changes: list[tuple[dict[str, Any], str]] = [
        ({"ratios": (0.4, 1.0)}, r"frequency ratios: given 0\.4; .*0\.5 to 2\b"),
        ({"ratios": (1.0, float("nan"))}, "frequency ratios: given nan; "),
        ({"ratios": (1.1, 1.0)}, r"frequency ratios: given 1\.1, 1; .*\b2\b"),
        ({"ratios": (1.0,)}, r"frequency ratios: given 1; .*\b2\b"),
        ({"amplitudes": [0.02, 0.01]}, "rising"),
        ({"scene": "nowhere.yaml"}, r"nowhere\.yaml"),
    ]
    for change, line in changes:
        status, result = maps.answer(maps.ask(tmp_path / "map.npz", **({"amplitudes": [0.01, 0.02]} | change)))
        assert status == GoalStatus.STATUS_ABORTED
        assert re.search(line, result.message)
    assert not list(tmp_path.iterdir())


def test_a_second_map_is_aborted_and_a_cancelled_one_is_kept(maps: MapStand, tmp_path: Path) -> None:
    first = maps.ask(tmp_path / "first.npz", MANY)
    maps.until(lambda: any(message.done for message in maps.feedback))
    status, result = maps.answer(maps.ask(tmp_path / "second.npz", MANY))
    assert (status, "another" in result.message) == (GoalStatus.STATUS_ABORTED, True)
    maps.wait(first.cancel_goal_async())
    status, result = maps.answer(first)
    assert (status, "400" in result.message) == (GoalStatus.STATUS_CANCELED, True)
    (kept,) = tmp_path.iterdir()
    assert kept.name.startswith("first.npz")
    assert kept.name != "first.npz"


def test_a_defect_is_told_and_the_node_goes_on(maps: MapStand, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def defective(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a defect")

    with monkeypatch.context() as patched:
        patched.setattr("atpid_control.nodes.action_servers.build_map", defective)
        status, result = maps.answer(maps.ask(tmp_path / "map.npz", [0.01, 0.02]))
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message.endswith("ZeroDivisionError: a defect")
    assert maps.answer(maps.ask(tmp_path / "map.npz", [0.01, 0.012]))[0] == GoalStatus.STATUS_SUCCEEDED
