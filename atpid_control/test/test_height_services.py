# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The SelectHeight services over real DDS: what each method answers, refusals, and a loop they do not hold up."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.srv import SelectHeight
from rclpy.context import Context
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Empty

from atpid_common.nodes.turns import TurnExecutor
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.computation import threaded
from atpid_control.nodes.height_services import HeightServices
from atpid_control.selection import Excitation, HeightSelector, make_selector
from atpid_control.selection.checks import Resonance
from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.protocol import Selection
from atpid_control.selection.registry import at_any_frequency
from atpid_sim.scene import load_scene

ROOT = Path(__file__).parents[2]
MAP = ROOT / "atpid_control" / "config" / "maps" / "standard.npz"
SCENE = load_scene(ROOT / "scenes" / "thesis_4_3.yaml")
MAKE = partial(make_selector, scene=SCENE, height_map=MAP)
STEADY = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.49)


class Stand:
    """A node with the services and a client, on one executor."""

    def __init__(self, make: Callable[[str], HeightSelector] = MAKE) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.node = Node("selector_node", context=self.context)
        self.client = Node("client", context=self.context)
        self.latest: Estimate | None = None
        self.worker = threaded("requested-selection")
        HeightServices(self.node, self.worker, make, "lookup", self.situation, SCENE)
        for node in (self.node, self.client):
            self.executor.add_node(node)

    def situation(self) -> tuple[Estimate | None, float, Resonance]:
        return self.latest, 0.3, Resonance(SCENE.frequency_hz, 0.03)

    def begin(self, method: str, **request: float) -> Future:
        service = self.client.create_client(SelectHeight, f"selector_node/{method}")
        assert service.wait_for_service(timeout_sec=100.0)
        return service.call_async(SelectHeight.Request(**request))

    def until(self, condition: Callable[[], Any]) -> None:
        end = time.monotonic() + 100.0
        while not condition():
            assert time.monotonic() < end, "the answer waited for did not come"
            self.executor.spin_once(timeout_sec=0.02)

    def ask(self, method: str, **request: float) -> SelectHeight.Response:
        answer = self.begin(method, **request)
        self.until(answer.done)
        response: SelectHeight.Response = answer.result()
        return response

    def close(self) -> None:
        self.worker.shutdown()
        for node in (self.node, self.client):
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_each_method_answers_what_it_would_choose(stand: Stand) -> None:
    for method in ("lookup", "pca", "direct"):
        answer = stand.ask(method, amplitude=0.03)
        assert answer.success
        assert answer.method == method
        assert answer.height == pytest.approx(0.57, rel=0.06)
        assert answer.efficiency > 0.79
        assert answer.price == 0.0


def unhurried(method: str) -> HeightSelector:
    return at_any_frequency(DirectSelector(SCENE, deadline=math.inf), SCENE) if method == "direct" else MAKE(method)


def test_the_price_of_a_margin_is_nan_where_the_method_does_not_compute_it() -> None:
    stand, given = Stand(unhurried), {"amplitude": 0.03, "amplitude_std": 1e-4, "margin": 3.0}
    try:
        assert math.isnan(stand.ask("lookup", **given).price)
        answer = stand.ask("direct", **given)
        assert 0.0 < answer.price < 0.2
        assert "in 123 of 123 sampled systems" in answer.message
    finally:
        stand.close()


def test_before_any_estimate_there_is_a_clear_answer(stand: Stand) -> None:
    answer = stand.ask("direct")
    assert not answer.success
    assert "no steady estimate yet" in answer.message
    stand.latest = STEADY
    assert stand.ask("lookup").success


@pytest.mark.parametrize("method", ["select", "lookup", "pca", "direct"])
def test_nonsense_is_refused_by_every_method(stand: Stand, method: str) -> None:
    nonsense: list[dict[str, float]] = [
        {"amplitude": -1.0}, {"amplitude": math.nan}, {"amplitude": 0.03, "amplitude_std": -1.0},
        {"amplitude": 0.03, "margin": -3.0}, {"amplitude": 0.03, "frequency": 20.0},
    ]  # fmt: skip
    for request in nonsense:
        answer = stand.ask(method, **request)
        assert not answer.success
        assert "given" in answer.message
        assert "allowed" in answer.message
        assert math.isnan(answer.height)


def test_an_amplitude_outside_the_map_is_refused(stand: Stand) -> None:
    assert "outside its 0.002 to 0.08 m" in stand.ask("lookup", amplitude=5.0).message


def test_a_height_beyond_the_ceiling_s_range_is_named(stand: Stand) -> None:
    message = stand.ask("lookup", amplitude=0.08).message
    assert message.endswith(" m is beyond ceiling.range (0.017 to 1 m); the loop would send the ceiling to 1 m")


class Blocked:
    """A selector that answers when the test lets it."""

    method, simulates = "lookup", False

    def __init__(self) -> None:
        self.begun, self.proceed = threading.Event(), threading.Event()

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        self.begun.set()
        assert self.proceed.wait(100.0)
        raise ZeroDivisionError("a defect")


def test_the_node_goes_on_while_a_height_is_computed_and_a_defect_is_reported() -> None:
    selector = Blocked()
    stand = Stand(lambda _method: selector)
    try:
        taken: list[Empty] = []
        stand.node.create_subscription(Empty, "loop", taken.append, 10)
        loop = stand.client.create_publisher(Empty, "loop", 10)
        answer = stand.begin("lookup", amplitude=0.03)
        stand.until(selector.begun.is_set)
        stand.until(lambda: loop.publish(Empty()) or len(taken) >= 5)
        assert not answer.done()
        selector.proceed.set()
        stand.until(answer.done)
        assert not answer.result().success
        assert answer.result().message == "internal error: ZeroDivisionError: a defect"
    finally:
        selector.proceed.set()
        stand.close()
