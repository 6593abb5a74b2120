# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selector node over real DDS: one command for each estimate, requests, silent partners, live parameters."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.action import SearchHeight
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, Excitation
from atpid_interfaces.srv import SelectHeight
from diagnostic_msgs.msg import DiagnosticStatus
from graph_runs import parameters
from node_graph import NodeGraph
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile

from atpid_common.nodes.messages import EVENTS, STATES, nanoseconds_of, time_of
from atpid_common.testing import PATIENCE
from atpid_control.loop.settings import controller_of, selector_of
from atpid_control.nodes.selector_node import HELD, SelectorNode

BLOCK = 50_000_000  # [ns]
SILENCE = 0.15  # a short time-out [s]


class Loop(NodeGraph):
    """A selector, and a peer in the places of identifier, motor and operator."""

    def __init__(self, scene: Path, out: Path, *, lockstep: bool = False, **changes: Any) -> None:
        super().__init__()
        self.scene, given = parameters(scene, out, lockstep=lockstep)
        self.make(SelectorNode, given["selector_node"] | changes)
        self.commands = self.collect(CeilingCommand, "ceiling/command")
        self.events = self.collect(Event, "events", EVENTS)
        self.excitation = self.peer.create_publisher(Excitation, "excitation", STATES)
        self.state = self.peer.create_publisher(CeilingState, "ceiling/state", STATES)
        self.runs = self.peer.create_publisher(Event, "events", EVENTS)
        self.ticks = 0
        self.peer.create_timer(SILENCE, self._tick)
        self.until(lambda: self.commands, lambda: self.excitation.publish(Excitation(handshake=True)))
        self.until(lambda: self.state.get_subscription_count() and self.runs.get_subscription_count() == 2)
        self.until(lambda: lockstep or self.peer.count_publishers("/diagnostics"))
        self.handshake = self.commands[-1]
        self.stamp = self.begin = time.time_ns()

    def _tick(self) -> None:
        self.ticks += 1

    def let_time_pass(self) -> None:
        """Spin for three of the short time-outs."""
        end = self.ticks + 4
        self.until(lambda: self.ticks >= end)

    def estimate(self, amplitude: float = 0.015, frequency: float | None = None) -> CeilingCommand:
        """Send one steady estimate; return the command that answers it."""
        self.stamp += BLOCK
        message = Excitation(quality=Excitation.STEADY, amplitude=amplitude, amplitude_std=1e-6)
        message.frequency, message.beam_amplitude = frequency or self.scene.frequency_hz, math.nan
        message.header.stamp = time_of(self.stamp)
        self.excitation.publish(message)
        self.until(lambda: self.commands[-1].header.stamp == message.header.stamp)
        command: CeilingCommand = self.commands[-1]
        return command

    def event(self, kind: str, source: str = "") -> None:
        """Publish an event at the end of the last block, and wait until all have it."""
        event = Event(kind=kind, node=source)
        event.header.stamp = time_of(self.stamp + BLOCK)
        self.runs.publish(event)
        self.until(lambda: event in self.events)
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.01)

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]

    def found(self, kind: str) -> Any:
        """Wait for an event of a kind; return the first one."""
        self.until(lambda: kind in self.kinds())
        return next(event for event in self.events if event.kind == kind)

    def status(self, name: str, level: bytes) -> DiagnosticStatus:
        self.until(lambda: any(s.name == name and s.level == level for s in self.statuses))
        return next(s for s in reversed(self.statuses) if s.name == name and s.level == level)

    def given(self, name: str, value: Any) -> Any:
        """Set a parameter; return the result."""
        return self.set("selector_node", name, value)

    def select(self, amplitude: float, frequency: float = 0.0) -> Any:
        return self.call("selector_node/select", SelectHeight, amplitude=amplitude, frequency=frequency)


Make = Callable[..., Loop]


@pytest.fixture
def make(scenes: Path, tmp_path: Path) -> Iterator[Make]:
    with ExitStack() as stack:
        scene = scenes / "thesis_4_3.yaml"
        yield lambda **given: stack.enter_context(closing(Loop(scene, tmp_path, **given)))


@pytest.fixture(scope="module")
def shared(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Loop]:
    """A selector in real time that has selected a height."""
    with closing(Loop(scenes / "thesis_4_3.yaml", tmp_path_factory.mktemp("shared"))) as loop:
        loop.select(0.03)  # starts the thread of its requests
        yield loop


@pytest.fixture
def loop(shared: Loop) -> Loop:
    """It has selected a height for 0.015 m; what it published before is dropped."""
    shared.until(lambda: shared.estimate().height > 0.0)
    del shared.events[:], shared.statuses[:], shared.commands[:-1]
    return shared


def test_in_lockstep_each_estimate_gets_one_command_with_its_stamp(make: Make) -> None:
    loop = make(lockstep=True)
    assert (loop.handshake.handshake, math.isnan(loop.handshake.height)) == (True, True)
    early = loop.select(0.0)
    assert (early.success, math.isnan(early.height), "estimate" in early.message) == (False, True, True)
    commands = [loop.estimate() for _ in range(6)]
    assert [nanoseconds_of(c.header.stamp) for c in commands] == [loop.begin + BLOCK * k for k in range(1, 7)]
    assert [c.sequence for c in commands] == [0, 0, 0, 1, 1, 1]
    assert commands[-1].method == "lookup"
    assert commands[-1].height == pytest.approx(0.29, rel=0.05)
    assert loop.select(0.0).height == pytest.approx(0.29, rel=0.05)
    # off resonance: refused once, and the height stays
    assert {loop.estimate(0.03, 6.5).height for _ in range(10)} == {commands[-1].height}
    loop.found("refused")
    refused = [(event.severity, event.value) for event in loop.events if event.kind == "refused"]
    assert refused == [(Event.WARNING, 6.5)]


def test_the_service_answers_for_the_amplitude_given_or_gives_the_reason(loop: Loop) -> None:
    answer = loop.select(0.03, 5.47)
    assert (answer.success, answer.method) == (True, "lookup")
    assert answer.height == pytest.approx(0.57, rel=0.05)
    assert answer.efficiency > 0.76
    for amplitude, given in ((5.0, "5"), (math.nan, "nan;")):
        answer = loop.select(amplitude)
        assert (answer.success, math.isnan(answer.height)) == (False, True)
        assert given in answer.message.split()


def test_estimates_that_stay_away_are_an_event_and_in_the_diagnostics(loop: Loop) -> None:
    stale = loop.found("stale")
    assert stale.severity == Event.ALARM
    assert stale.text.split()[3] == "excitation"
    assert stale.value >= 0.4
    assert loop.status("selector_node: inputs", DiagnosticStatus.STALE).message.split()[-1] == "excitation"
    loop.estimate()
    assert loop.found("resumed").value >= stale.value


def test_after_the_end_of_a_run_nothing_is_expected(make: Make) -> None:
    """The event counts from a node that has announced the begin of a run, or from any where none has."""
    loop = make(stale_timeout=SILENCE)

    def falls_silent(*, reported: bool) -> None:
        """Send the messages that the event has overtaken, and none after them."""
        before = loop.kinds().count("stale")
        loop.estimate()
        loop.state.publish(CeilingState(height=0.3))
        if reported:
            loop.until(lambda: loop.kinds().count("stale") > before)
        else:
            loop.let_time_pass()
            assert loop.kinds().count("stale") == before

    falls_silent(reported=True)
    loop.until(lambda: {text.split()[3] for text in loop.texts("stale")} == {"excitation", "ceiling/state"})
    loop.event(Event.FINISHED)
    falls_silent(reported=False)
    falls_silent(reported=True)  # in the next run
    loop.event(Event.STARTED, "plant_node")
    loop.event(Event.FINISHED, "stranger")
    falls_silent(reported=True)
    loop.event(Event.FINISHED, "plant_node")
    falls_silent(reported=False)


def test_silence_ends_a_search_with_the_reason(make: Make) -> None:
    loop = make()
    client = ActionClient(loop.peer, SearchHeight, "selector_node/search")
    loop.until(client.server_is_ready)
    sent = client.send_goal_async(SearchHeight.Goal(step=0.1, dwell=2.0, lowest=0.1, highest=0.9))
    loop.until(sent.done)
    result = sent.result().get_result_async()
    loop.estimate()
    loop.until(result.done)
    assert result.result().result.message.split()[-1] == "excitation"
    client.destroy()


def test_incompatible_quality_of_service_is_an_event(loop: Loop) -> None:
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    stranger = loop.peer.create_subscription(CeilingCommand, "ceiling/command", lambda _: None, kept)
    event = loop.found("qos")
    assert event.severity == Event.WARNING
    assert {"ceiling/command:", "durability,"} <= set(event.text.split())
    assert "durability" in loop.status("selector_node: quality of service", DiagnosticStatus.ERROR).message
    loop.peer.destroy_subscription(stranger)


def test_a_live_parameter_holds_from_the_next_estimate_on_and_is_recorded(loop: Loop) -> None:
    assert loop.given("dead_band", 0.5).successful
    assert {"dead_band:", "0.01", "0.5"} <= set(loop.found("parameter").text.split())
    assert loop.estimate(0.018).reason == "inside dead band"
    assert loop.given("margin", 0.0).successful
    loop.until(lambda: loop.estimate(0.018).reason == "selected")
    for name, value in (("dead_band", 0.01), ("margin", 3.0)):
        assert loop.given(name, value).successful


@pytest.mark.parametrize(
    ("name", "value"), [("margin", -3.0), ("dead_band", math.nan), ("steady_count", 0), ("map", "another.npz")]
)
def test_a_bad_value_or_a_parameter_that_is_read_once_is_refused(loop: Loop, name: str, value: Any) -> None:
    result = loop.given(name, value)
    assert not result.successful
    assert ("read-only" if name == "map" else name) in result.reason
    assert "parameter" not in loop.kinds()


def test_a_held_ceiling_gets_no_height_until_it_is_released(loop: Loop) -> None:
    height = loop.commands[-1].height
    assert loop.given("hold", True).successful
    held = loop.estimate()
    assert (held.reason, math.isnan(held.height)) == (HELD, True)
    assert loop.given("hold", False).successful
    assert loop.estimate().height == height


def test_another_method_selects_once_it_is_made(make: Make) -> None:
    loop = make(fallback_count=10_000)  # these estimates follow each other faster than blocks do
    loop.until(lambda: loop.estimate().height > 0.0)
    before = loop.commands[-1]
    assert loop.given("method", "pca").successful
    loop.until(lambda: (command := loop.estimate()).method == "pca" and command.height > 0.0)
    assert loop.commands[-1].sequence > before.sequence
    loop.until(lambda: any(event.text.endswith(" pca") and "->" not in event.text for event in loop.events))


def test_a_method_that_cannot_be_made_is_refused_and_the_last_one_goes_on(make: Make) -> None:
    loop = make(method="pca", map="", fallback_count=10_000)
    loop.until(lambda: loop.estimate().height > 0.0)
    assert loop.given("method", "lookup").successful
    loop.until(lambda: loop.estimate() and "refused" in loop.kinds())
    assert {"map", "pca"} <= set(loop.found("refused").text.replace(":", " ").split())
    command = loop.estimate()
    assert (command.method, command.height > 0.0) == ("pca", True)


class Slow:
    """A selector or controller one of whose methods first does something else."""

    def __init__(self, inner: Any, name: str, first: Callable[[], object]) -> None:
        self.inner = inner
        setattr(self, name, partial(self.follow, getattr(inner, name), first))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def follow(self, act: Callable[..., Any], first: Callable[[], object], *arguments: Any, **named: Any) -> Any:
        first()
        return act(*arguments, **named)


def test_each_estimate_is_answered_while_a_height_is_computed(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    proceed = threading.Event()
    proceed.set()  # the node begins with a selection

    def slow(*arguments: Any, **named: Any) -> Any:
        return Slow(selector_of(*arguments, **named), "select", lambda: proceed.wait(PATIENCE))

    monkeypatch.setattr("atpid_control.nodes.selector_node.selector_of", slow)
    loop = make(method="direct", selection_deadline=60.0)  # so that the height does not depend on the machine's load
    proceed.clear()
    commands = [loop.estimate() for _ in range(10)]
    assert [command.reason for command in commands[3:]] == ["computing"] * 7
    assert all(math.isnan(command.height) for command in commands)
    proceed.set()
    loop.until(lambda: loop.estimate().height > 0.0)
    assert loop.commands[-1].height == pytest.approx(0.29, rel=0.06)
    assert loop.commands[-1].sequence == 1


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_slow_controller_is_told_in_real_time(make: Make, monkeypatch: pytest.MonkeyPatch, lockstep: bool) -> None:
    def slow(*arguments: Any) -> Any:
        return Slow(controller_of(*arguments), "answer", lambda: time.sleep(1.2e-9 * BLOCK))

    monkeypatch.setattr("atpid_control.nodes.selector_node.controller_of", slow)
    loop = make(lockstep=lockstep)
    loop.estimate(0.02)
    loop.until(lambda: lockstep or "slow" in loop.kinds())
    for _ in range(20):
        loop.executor.spin_once(timeout_sec=0.0)
    assert ("slow" in loop.kinds()) is not lockstep
