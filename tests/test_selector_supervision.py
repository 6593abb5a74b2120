# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selector in real time: silent partners, quality of service, live parameters, heights computed beside the loop."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.action import SearchHeight
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, Excitation
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from graph_runs import parameters
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from atpid_common.nodes.messages import EVENTS, STATES, time_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.selector_node import SelectorNode
from atpid_control.selection import SelectionError

BLOCK = 50_000_000  # [ns]


class Loop:
    """A selector in real time and a peer in the places of identifier and motor."""

    def __init__(self, scenes: Path, out: Path, **changes: Any) -> None:
        rclpy.init()
        self.scene, given = parameters(scenes / "thesis_4_3.yaml", out, lockstep=False)
        overrides = [Parameter(name, value=value) for name, value in (given["selector_node"] | changes).items()]
        self.selector, self.peer = SelectorNode(parameter_overrides=overrides), Node("peer")
        self.commands: list[CeilingCommand] = []
        self.events: list[Event] = []
        self.statuses: list[DiagnosticStatus] = []
        self.excitation = self.peer.create_publisher(Excitation, "excitation", STATES)
        self.state = self.peer.create_publisher(CeilingState, "ceiling/state", STATES)
        self.runs = self.peer.create_publisher(Event, "events", EVENTS)
        self.peer.create_subscription(CeilingCommand, "ceiling/command", self.commands.append, STATES)
        self.peer.create_subscription(Event, "events", self.events.append, EVENTS)
        self.peer.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, 10)
        self.executor = TurnExecutor()
        self.executor.add_node(self.selector)
        self.executor.add_node(self.peer)
        handshake = Excitation()
        handshake.handshake = True
        self.until(lambda: self.commands, lambda: self.excitation.publish(handshake))
        self.until(lambda: self.peer.count_publishers("/diagnostics") and self.state.get_subscription_count())
        self.until(lambda: self.runs.get_subscription_count() == 2)
        while self.commands and self.commands[-1].handshake:
            self.commands.clear()
            self.executor.spin_once(timeout_sec=0.1)
        self.stamp = time.time_ns()

    def on_diagnostics(self, array: DiagnosticArray) -> None:
        self.statuses += array.status

    def until(self, condition: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        end = time.monotonic() + 100.0
        while not condition():
            assert time.monotonic() < end, "the event waited for did not come"
            act()
            self.executor.spin_once(timeout_sec=0.02)

    def estimate(self, amplitude: float = 0.015) -> CeilingCommand:
        """Send one steady estimate; return the command that answers it."""
        self.stamp += BLOCK
        message = Excitation(quality=Excitation.STEADY, amplitude=amplitude, amplitude_std=1e-6)
        message.frequency, message.beam_amplitude = self.scene.frequency_hz, math.nan
        message.header.stamp = time_of(self.stamp)
        self.excitation.publish(message)
        self.until(lambda: self.commands and self.commands[-1].header.stamp == message.header.stamp)
        return self.commands[-1]

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]

    def found(self, kind: str) -> Event:
        self.until(lambda: kind in self.kinds())
        return next(event for event in self.events if event.kind == kind)

    def status(self, name: str, level: bytes) -> DiagnosticStatus:
        self.until(lambda: any(s.name == name and s.level == level for s in self.statuses))
        return next(s for s in reversed(self.statuses) if s.name == name and s.level == level)

    def set(self, name: str, value: Any) -> Any:
        client = self.peer.create_client(SetParameters, "selector_node/set_parameters")
        assert client.wait_for_service(timeout_sec=100.0)
        answer = client.call_async(SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()]))
        self.until(answer.done)
        return answer.result().results[0]

    def close(self) -> None:
        self.selector.close()
        for node in (self.selector, self.peer):
            node.destroy_node()
        self.executor.shutdown()
        rclpy.try_shutdown()


Make = Callable[..., Loop]


@pytest.fixture
def make(scenes: Path, tmp_path: Path) -> Iterator[Make]:
    made: list[Loop] = []

    def loop(**changes: Any) -> Loop:
        made.append(Loop(scenes, tmp_path, **changes))
        return made[-1]

    yield loop
    for item in made:
        item.close()


def test_estimates_that_stay_away_are_an_event_and_in_the_diagnostics(make: Make) -> None:
    loop = make()
    loop.estimate()
    stale = loop.found("stale")
    assert stale.severity == Event.ALARM
    assert stale.text.startswith("no message on excitation for ")
    assert stale.value >= 0.4
    assert loop.status("selector_node: inputs", DiagnosticStatus.STALE).message == "no messages on excitation"
    loop.estimate()
    assert loop.found("resumed").value >= stale.value


def test_a_silent_motor_is_an_event(make: Make) -> None:
    loop = make()
    loop.state.publish(CeilingState(height=0.3))
    assert "ceiling/state" in loop.found("stale").text


def test_after_the_end_of_a_run_nothing_is_expected(make: Make) -> None:
    loop = make(stale_timeout=30.0)
    loop.estimate()
    loop.state.publish(CeilingState(height=0.3))
    assert loop.selector._supervision.stale.running
    finished = Event(kind=Event.FINISHED)
    finished.header.stamp = time_of(loop.stamp + BLOCK)
    loop.runs.publish(finished)
    loop.until(lambda: not loop.selector._supervision.stale.running)
    loop.estimate()  # the last one, which the event has overtaken
    loop.state.publish(CeilingState(height=0.3))
    assert not loop.selector._supervision.stale.running
    loop.estimate()  # of the next run
    assert loop.selector._supervision.stale.running


def test_a_strangers_end_of_the_run_does_not_stop_the_watch(make: Make) -> None:
    """The event counts from a node that has announced the begin of a run."""
    loop = make(stale_timeout=30.0)
    loop.estimate()
    loop.state.publish(CeilingState(height=0.3))
    for name, kind, stops in (("plant_node", Event.STARTED, False), ("a stranger", Event.FINISHED, False),
                              ("plant_node", Event.FINISHED, True)):  # fmt: skip
        event = Event(kind=kind)
        event.node, event.header.stamp = name, time_of(loop.stamp + BLOCK)
        heard = len(loop.events)
        loop.runs.publish(event)
        loop.until(lambda heard=heard: len(loop.events) > heard)  # type: ignore[misc]
        loop.until(lambda stops=stops: loop.selector._supervision.stale.running is not stops)  # type: ignore[misc]


def test_silence_ends_a_search_with_the_reason(make: Make) -> None:
    loop = make()
    client = ActionClient(loop.peer, SearchHeight, "selector_node/search")
    assert client.wait_for_server(timeout_sec=100.0)
    sent = client.send_goal_async(SearchHeight.Goal(step=0.1, dwell=2.0, lowest=0.1, highest=0.9))
    loop.until(sent.done)
    result = sent.result().get_result_async()
    loop.estimate()
    loop.until(result.done)
    assert result.result().result.message == "no messages on excitation"
    client.destroy()


def test_incompatible_quality_of_service_is_an_event(make: Make) -> None:
    loop = make()
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    loop.peer.create_subscription(CeilingCommand, "ceiling/command", lambda _: None, kept)
    event = loop.found("qos")
    assert event.severity == Event.WARNING
    assert event.text.startswith("ceiling/command: a subscription has another durability, so that no message passes")
    assert "durability" in loop.status("selector_node: quality of service", DiagnosticStatus.ERROR).message


def test_a_missed_deadline_is_counted(make: Make) -> None:
    loop = make()
    loop.estimate()

    def missed() -> bool:
        values = [{v.key: v.value for v in s.values} for s in loop.statuses if s.name.endswith("quality of service")]
        return any(int(value.get("ceiling/command deadlines missed", 0)) > 0 for value in values)

    loop.until(missed)


@pytest.mark.slow
def test_statuses_have_standard_names_and_a_hardware_id(make: Make) -> None:
    loop = make()
    loop.until(lambda: len(loop.statuses) >= 3)
    names = {status.name: status.hardware_id for status in loop.statuses}
    assert names == {
        "selector_node: height selection": "none",
        "selector_node: inputs": "none",
        "selector_node: quality of service": "none",
    }


def test_a_live_parameter_holds_from_the_next_estimate_on_and_is_recorded(make: Make) -> None:
    loop = make()
    heights = {loop.estimate().height for _ in range(8)}
    assert len({height for height in heights if height > 0.0}) == 1
    assert loop.set("dead_band", 0.5).successful
    assert loop.found("parameter").text == "parameter dead_band: 0.01 -> 0.5"
    assert loop.estimate(0.018).reason == "inside dead band"
    assert loop.set("margin", 0.0).successful
    loop.until(lambda: loop.estimate(0.018).reason == "selected")


@pytest.mark.parametrize(("name", "value"), [("margin", -3.0), ("dead_band", math.nan), ("steady_count", 0)])
def test_a_bad_value_is_refused_with_a_sentence(make: Make, name: str, value: Any) -> None:
    loop = make()
    result = loop.set(name, value)
    assert not result.successful
    assert name in result.reason
    assert "parameter" not in loop.kinds()


def test_a_parameter_that_is_read_once_is_refused(make: Make) -> None:
    loop = make()
    result = loop.set("map", "another.npz")
    assert not result.successful
    assert "read-only" in result.reason


def test_a_held_ceiling_gets_no_height_until_it_is_released(make: Make) -> None:
    loop = make()
    loop.until(lambda: loop.estimate().height > 0.0)
    height = loop.commands[-1].height
    assert loop.set("hold", True).successful
    held = loop.estimate()
    assert (held.reason, math.isnan(held.height)) == ("held by the operator", True)
    assert loop.set("hold", False).successful
    assert loop.estimate().height == height


def test_another_method_selects_once_it_is_made(make: Make) -> None:
    loop = make(fallback_count=10_000)  # these estimates follow each other faster than blocks do
    loop.until(lambda: loop.estimate().height > 0.0)
    before = loop.commands[-1]
    assert loop.set("method", "pca").successful
    loop.until(lambda: (command := loop.estimate()).method == "pca" and command.height > 0.0)
    assert loop.commands[-1].sequence > before.sequence
    assert "heights are selected by pca" in [event.text for event in loop.events]


def test_a_method_that_cannot_be_made_is_refused_and_the_last_one_goes_on(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = make()
    loop.until(lambda: loop.estimate().height > 0.0)

    def fails(method: str) -> None:
        raise SelectionError(f"method {method}: no map given")

    monkeypatch.setattr(loop.selector, "_make_selector", fails)
    assert loop.set("method", "pca").successful
    loop.until(lambda: loop.estimate() and "refused" in loop.kinds())
    assert loop.found("refused").text == "method pca: no map given; heights are still selected by lookup"
    assert (loop.estimate().method, loop.estimate().height > 0.0) == ("lookup", True)


def test_each_estimate_is_answered_while_a_height_is_computed(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    loop = make(method="direct", selection_deadline=60.0)  # so that the height does not depend on the machine's load
    proceed = threading.Event()
    controller: Any = loop.selector._controller
    select = controller._inner._selector.select

    def slow(*arguments: Any, **named: Any) -> Any:
        assert proceed.wait(100.0)
        return select(*arguments, **named)

    monkeypatch.setattr(controller._inner._selector, "select", slow)
    commands = [loop.estimate() for _ in range(10)]
    assert [command.reason for command in commands[3:]] == ["computing"] * 7
    assert all(math.isnan(command.height) for command in commands)
    proceed.set()
    loop.until(lambda: loop.estimate().height > 0.0)
    assert loop.commands[-1].height == pytest.approx(0.29, rel=0.06)
    assert loop.commands[-1].sequence == 1
