# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node over real DDS: commands, time-outs, permission, services, hostile messages."""

import time
from collections.abc import Callable, Iterator
from math import nan
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import Event, Excitation, ExcitationCommand, ExcitationState, SupervisorState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from atpid_common.errors import InputError
from atpid_common.nodes.turns import TurnExecutor
from atpid_driver.nodes.excitation_node import ExcitationNode

SIMULATED: dict[str, Any] = {
    "backend": "simulated", "highest_amplitude": 0.02, "lowest_frequency": 1.0, "highest_frequency": 20.0,
    "rise_time": 0.2, "frequency_rate": 20.0,
}  # fmt: skip


class Graph:
    """An excitation node and an operator, in one context on one executor."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.operator = self.add(Node("operator", context=self.context))
        self.states: list[ExcitationState] = []
        self.events: list[Event] = []
        self.operator.create_subscription(ExcitationState, "excitation/state", self.states.append, 100)
        self.operator.create_subscription(Event, "events", self.events.append, 100)
        self.commands = self.operator.create_publisher(ExcitationCommand, "excitation/command", 10)
        self.supervisor = self.operator.create_publisher(SupervisorState, "supervisor/state", 10)
        self.estimates = self.operator.create_publisher(Excitation, "excitation", 10)
        self.permits: SupervisorState | None = None

    def add(self, node: Any) -> Any:
        self.executor.add_node(node)
        return node

    def start(self, **parameters: Any) -> ExcitationNode:
        values = [Parameter(name, value=value) for name, value in (SIMULATED | parameters).items()]
        node: ExcitationNode = self.add(ExcitationNode(parameter_overrides=values, context=self.context))
        self.until(lambda: self.commands.get_subscription_count() and self.states)
        return node

    @property
    def state(self) -> ExcitationState:
        return self.states[-1]

    def until(self, condition: Callable[[], object], command: ExcitationCommand | None = None,
              limit: float = 60.0) -> float:  # fmt: skip
        """Spin until something is true, commanding and permitting as often as in a run; return how long it took [s]."""
        begin, due = time.monotonic(), 0.0
        while not condition():
            now = time.monotonic()
            assert now - begin < limit, "what was waited for did not come"
            if now > due:
                due = now + 0.05
                if command is not None:
                    self.send(command)
                if self.permits is not None:
                    self.permits.header.stamp = self.operator.get_clock().now().to_msg()
                    self.supervisor.publish(self.permits)
            self.executor.spin_once(timeout_sec=0.01)
        return time.monotonic() - begin

    def send(self, command: ExcitationCommand) -> None:
        command.header.stamp = self.operator.get_clock().now().to_msg()
        self.commands.publish(command)

    def run(self, command: ExcitationCommand) -> None:
        self.until(lambda: self.state.mode == ExcitationState.RUNNING, command)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self.operator.create_client(kind, f"excitation_node/{name}")
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        self.operator.destroy_client(client)
        return future.result()

    def change(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.call(ChangeState, "change_state", request).success)

    def reported(self, words: str) -> bool:
        return any(words in event.text for event in self.events)

    def close(self) -> None:
        for node in self.executor.get_nodes():
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def graph() -> Iterator[Graph]:
    made = Graph()
    yield made
    made.close()


def sine(**changes: Any) -> ExcitationCommand:
    values = {"kind": ExcitationCommand.SINE, "amplitude": 0.01, "frequency": 5.0, "sequence": 1}
    return ExcitationCommand(**values | changes)


def test_a_command_is_put_out_and_its_silence_ends_it(graph: Graph) -> None:
    graph.start(stale_timeout=0.3)
    assert graph.state.mode == ExcitationState.OFF
    graph.run(sine())
    assert (graph.state.amplitude, graph.state.frequency, graph.state.sequence) == (0.01, 5.0, 1)
    took = graph.until(lambda: graph.state.mode == ExcitationState.OFF)
    assert 0.2 < took < 2.0  # 0.3 s of silence and 0.2 s of decay; the rest for a machine with other work
    graph.until(lambda: graph.reported("no message on excitation/command"))
    assert graph.state.amplitude == 0.0
    graph.run(sine())  # and goes on with the next command
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, ExcitationCommand())


def test_it_is_off_in_every_state_but_active(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    assert graph.change(Transition.TRANSITION_DEACTIVATE)
    assert graph.state.mode == ExcitationState.OFF
    graph.until(lambda: graph.reported("the excitation node is inactive"), sine())
    assert graph.state.amplitude == 0.0
    assert graph.change(Transition.TRANSITION_ACTIVATE)
    graph.run(sine(sequence=2))
    assert graph.change(Transition.TRANSITION_DEACTIVATE)
    assert graph.change(Transition.TRANSITION_CLEANUP)
    graph.until(lambda: graph.state.mode == ExcitationState.UNCONFIGURED)
    assert graph.state.amplitude == 0.0


def test_a_stop_is_confirmed_and_lasts(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    answer = graph.call(Trigger, "stop", Trigger.Request())
    assert answer.success
    assert "excitation off" in answer.message
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 10, sine())
    assert {state.amplitude for state in graph.states[seen + 1 :]} == {0.0}


def test_it_runs_only_while_the_supervisor_permits(graph: Graph) -> None:
    graph.start(supervised=True)
    graph.until(lambda: len(graph.states) > 10, sine())
    assert graph.state.amplitude == 0.0
    graph.permits = SupervisorState(state=SupervisorState.READY, permit=True)
    graph.run(sine())
    graph.permits = SupervisorState(state=SupervisorState.FAULT, permit=False, reason="recorder_node is silent")
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    graph.until(lambda: graph.reported("the excitation ramps down: recorder_node is silent"))
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 20, sine())
    assert {state.amplitude for state in graph.states[seen:]} == {0.0}
    assert graph.reported("SINE not taken up: recorder_node is silent")
    graph.permits = SupervisorState(state=SupervisorState.READY, permit=True)
    graph.run(sine())  # a hold: the next command switches it on again
    graph.permits = SupervisorState(state=SupervisorState.FAULT, permit=False, reason="recorder_node is silent")
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    assert graph.change(Transition.TRANSITION_DEACTIVATE)
    assert not graph.change(Transition.TRANSITION_ACTIVATE)
    graph.permits = SupervisorState(state=SupervisorState.READY, permit=True)
    graph.until(lambda: graph.change(Transition.TRANSITION_ACTIVATE))
    graph.run(sine())
    graph.permits = None
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    graph.until(lambda: graph.reported("the supervisor is silent"))
    graph.permits = SupervisorState(state=SupervisorState.READY, permit=True)
    graph.run(sine())
    graph.permits = SupervisorState(state=SupervisorState.SAFE, stop=True, reason="stopped by the operator")
    graph.until(lambda: graph.reported("excitation switched off: stopped by the operator"), sine())
    graph.permits = SupervisorState(state=SupervisorState.READY, permit=True)
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 20, sine())
    assert graph.state.amplitude == 0.0  # a stop: a person activates it again
    assert graph.change(Transition.TRANSITION_ACTIVATE)
    graph.run(sine())


def test_two_commanders_end_it(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    intruder = graph.add(Node("intruder", context=graph.context))
    intruder.create_publisher(ExcitationCommand, "excitation/command", 10)
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    graph.until(lambda: graph.reported("excitation/command is published by /intruder and /operator"))
    assert not graph.reported("no message on")  # at once, and not after their silence


def test_beside_another_of_its_name_it_is_off_and_cannot_be_activated(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    other = graph.add(Node("excitation_node", context=graph.context))
    graph.until(lambda: any(event.kind == Event.DUPLICATE for event in graph.events), sine())
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    assert not graph.change(Transition.TRANSITION_ACTIVATE)
    other.destroy_node()
    graph.run(sine())


def test_a_command_that_waited_too_long_is_ignored(graph: Graph) -> None:
    node = graph.start()
    graph.run(sine())
    node._on_command(sine(sequence=2, frequency=6.0), {"received_timestamp": time.time_ns() - 10**10})
    graph.until(lambda: graph.reported("command ignored: it waited 10.00 s"), sine())
    assert (graph.state.sequence, graph.state.frequency) == (1, 5.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"amplitude": 0.05}, "amplitude: given 0.05; allowed: 0 to 0.02"),
        ({"amplitude": nan}, "amplitude: given nan"),
        ({"amplitude": -0.01}, "amplitude: given -0.01"),
        ({"frequency": 1e300}, "frequency: given 1e+300"),
        ({"kind": 77}, "kind: given 77"),
        ({"kind": ExcitationCommand.RANDOM, "end_frequency": 9.0}, "kind: given RANDOM; backend simulated"),
        ({"kind": ExcitationCommand.SWEEP, "end_frequency": 9.0, "duration": 0.0}, "duration: given 0"),
    ],
)
def test_a_command_that_may_not_be_followed_is_refused_once_and_the_output_stays(
    graph: Graph, changes: dict[str, Any], words: str
) -> None:
    graph.start()
    graph.run(sine())
    graph.until(lambda: graph.reported(words), sine(**{"sequence": 2} | changes))
    assert sum(words in event.text for event in graph.events) == 1
    assert (graph.state.amplitude, graph.state.frequency) == (0.01, 5.0)


def test_with_hold_the_identified_amplitude_comes_to_the_command(graph: Graph) -> None:
    """The support moves 0.8 times as far as the calibration has it."""
    graph.start()
    began = time.monotonic()
    last = 0.0

    def held() -> bool:
        nonlocal last
        now = time.monotonic()
        if now - last > 0.05:
            last = now
            estimate = Excitation(quality=Excitation.STEADY, amplitude=0.8 * graph.state.amplitude,
                                  frequency=graph.state.frequency, window=0.1)  # fmt: skip
            estimate.header.stamp = graph.operator.get_clock().now().to_msg()
            graph.estimates.publish(estimate)
        return bool(graph.state.held) and now - began > 3.0

    graph.until(held, sine(hold=True))
    assert 0.8 * graph.state.amplitude == pytest.approx(0.01, rel=0.012)
    assert graph.state.measured_amplitude == pytest.approx(0.01, rel=0.02)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"backend": "labjack_dac"}, "calibration is empty"),
        ({"backend": "other"}, "backend"),
        ({"highest_amplitude": 0.0}, "highest_amplitude of excitation_node: given 0; allowed: 1e-09"),
        ({"lowest_frequency": 30.0}, "need 0 < lowest < highest"),
        ({"stop_time": 0.5}, "stop_time"),
        ({"backend": "labjack_stream", "calibration": "x.yaml", "lockstep": True}, "lockstep with backend"),
    ],
)
def test_an_invalid_parameter_is_one_line(parameters: dict[str, Any], words: str) -> None:
    context = Context()
    rclpy.init(context=context)
    try:
        values = [Parameter(name, value=value) for name, value in (SIMULATED | parameters).items()]
        with pytest.raises(InputError) as error:
            ExcitationNode(parameter_overrides=values, context=context)
        assert words in str(error.value)
        assert "\n" not in str(error.value)
    finally:
        rclpy.shutdown(context=context)
