# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node over real DDS: commands, time-outs, permission, services, hostile messages."""

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import Any

import pytest
import rclpy
from atpid_interfaces.msg import Event, Excitation, ExcitationCommand, ExcitationState, SupervisorState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from atpid_common.errors import InputError
from atpid_common.nodes.turns import TurnExecutor
from atpid_driver.excitation.guarded import GuardedDrive
from atpid_driver.nodes.authority import DISCOVERY_TIME
from atpid_driver.nodes.excitation_node import DECIDED, ExcitationNode
from atpid_driver.standins import Control, build
from atpid_driver.standins.build import environment
from atpid_driver.standins.outputs import Outputs

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
        self.node = ExcitationNode(parameter_overrides=values, context=self.context)
        self.add(self.node)
        self.until(lambda: self.commands.get_subscription_count() and self.states)
        return self.node

    @property
    def lifecycle(self) -> str:
        return str(self.node._state_machine.current_state[1])

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

    def shakes(self, sequence: int) -> int:
        """Let it shake by a new command, armed again where this machine halted it meanwhile; return its sequence."""
        while self.state.mode != ExcitationState.RUNNING:
            if self.state.fault:
                self.arm()
            sequence += 1
            self.until(lambda: self.state.fault or self.state.mode == ExcitationState.RUNNING, sine(sequence=sequence))
        return sequence

    def stays_off(self, command: ExcitationCommand) -> None:
        """Command for a second; nothing is put out."""
        seen = len(self.states)
        self.until(lambda: len(self.states) > seen + 20, command)
        assert {state.amplitude for state in self.states[seen + 1 :]} == {0.0}

    def stopped(self, reason: str, command: ExcitationCommand) -> None:
        """Wait until the output has been stopped for a reason, which is latched, and the command is void."""
        self.until(lambda: self.state.mode == ExcitationState.OFF, command)
        self.until(lambda: self.reported(f"excitation switched off: {reason}"))
        self.stays_off(command)

    def arm(self) -> None:
        """Arm it as a person does; a busy machine may withdraw the permission meanwhile."""
        self.until(lambda: self.call(Trigger, "rearm", Trigger.Request()).success)

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
    graph.stays_off(sine())  # a commander that goes on is no person
    graph.run(sine(sequence=2))
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, ExcitationCommand())
    graph.run(sine(sequence=2))  # OFF and on again are decisions


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


READY = SupervisorState(state=SupervisorState.READY, permit=True)
SILENT = SupervisorState(state=SupervisorState.FAULT, permit=False, reason="no answer of recorder_node")
SAFE = SupervisorState(state=SupervisorState.SAFE, stop=True, reason="stopped by the operator")


def test_it_runs_only_while_the_supervisor_permits(graph: Graph) -> None:
    graph.start(supervised=True)
    graph.stays_off(sine())
    graph.permits = READY
    graph.until(lambda: graph.lifecycle == "active", sine())
    assert time.monotonic() - graph.node._duplicates.started > DISCOVERY_TIME
    graph.stays_off(sine())  # it was commanded before the exciter was armed
    graph.run(sine(sequence=2))


@pytest.mark.parametrize("way", ["a needed node is silent", "the supervisor is silent", "a stop"])
def test_every_stop_is_latched_until_a_person_arms_it_and_commands_anew(graph: Graph, way: str) -> None:
    graph.start(supervised=True)
    graph.permits = READY
    graph.until(lambda: graph.lifecycle == "active")
    graph.run(sine())
    withdrawn = {"a needed node is silent": SILENT, "the supervisor is silent": None, "a stop": SAFE}[way]
    graph.permits = withdrawn
    graph.stopped("the supervisor is silent" if withdrawn is None else str(withdrawn.reason), sine())
    refused = graph.call(Trigger, "rearm", Trigger.Request())
    assert not refused.success
    assert "no motion is permitted" in refused.message
    graph.permits = READY
    graph.until(lambda: graph.node._permit.granted)
    graph.stays_off(sine(sequence=2))  # newer than the stop, but not armed
    graph.arm()
    graph.stays_off(sine(sequence=2))  # armed, but older than that
    graph.run(sine(sequence=3))
    assert graph.call(Trigger, "rearm", Trigger.Request()).message == "armed already"
    graph.run(sine(sequence=3))


def test_a_command_made_without_permission_does_not_wait_for_it(graph: Graph) -> None:
    graph.start(supervised=True)
    graph.permits = READY
    graph.until(lambda: graph.lifecycle == "active")
    graph.permits = SILENT
    graph.until(lambda: not graph.node._permit.granted)
    graph.until(lambda: graph.reported("SINE not taken up: no answer of recorder_node"), sine())
    graph.permits = READY
    graph.until(lambda: graph.node._permit.granted)
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


def test_a_command_that_is_repeated_by_another_publisher_is_a_new_one(graph: Graph) -> None:
    graph.start(stale_timeout=0.3)
    for _ in range(2):
        graph.run(sine())
        graph.until(lambda: graph.state.mode == ExcitationState.OFF)
        graph.stays_off(sine())
        graph.operator.destroy_publisher(graph.commands)
        ended = time.monotonic()
        graph.until(lambda: graph.node.count_publishers("excitation/command") == 0)
        graph.until(lambda ended=ended: time.monotonic() - ended > 0.5)  # type: ignore[misc]
        graph.commands = graph.operator.create_publisher(ExcitationCommand, "excitation/command", 10)
        graph.until(graph.commands.get_subscription_count)


def test_a_program_that_is_started_again_at_once_and_hangs_is_no_person(graph: Graph) -> None:
    graph.start(stale_timeout=0.3)
    graph.run(sine())
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 40, sine())  # more messages than come from the second one
    graph.operator.destroy_publisher(graph.commands)
    graph.commands = graph.operator.create_publisher(ExcitationCommand, "excitation/command", 10)
    graph.until(graph.commands.get_subscription_count)
    refused = graph.node._gate._commander.refused
    graph.until(lambda: graph.node._gate._commander.refused > refused, sine())  # its count begins anew
    hangs = time.monotonic()
    graph.until(lambda: graph.state.mode == ExcitationState.OFF and time.monotonic() - hangs > 1.0)
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


def test_two_commanders_end_it(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    intruder = graph.add(Node("intruder", context=graph.context))
    intruder.create_publisher(ExcitationCommand, "excitation/command", 10)
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    graph.until(lambda: graph.reported("excitation/command is published by /intruder and /operator"))
    assert not graph.reported("no message on")  # at once, and not after their silence


def test_what_was_commanded_beside_another_does_not_move_it_once_that_has_left(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 60, sine())  # more messages than come beside the other one
    intruder = graph.add(Node("intruder", context=graph.context))
    intruder.create_publisher(ExcitationCommand, "excitation/command", 10)
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    graph.operator.destroy_publisher(graph.commands)  # the commander starts again meanwhile
    graph.commands = graph.operator.create_publisher(ExcitationCommand, "excitation/command", 10)
    graph.until(graph.commands.get_subscription_count)
    refused = graph.node._gate._commander.refused
    graph.until(lambda: graph.node._gate._commander.refused > refused, sine())
    graph.executor.remove_node(intruder)
    intruder.destroy_node()
    graph.until(lambda: graph.node.count_publishers("excitation/command") == 1)
    pauses = time.monotonic()
    graph.until(lambda: time.monotonic() - pauses > 1.5)  # for longer than `stale_timeout`
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


def test_beside_another_of_its_name_it_is_off_and_cannot_be_activated(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    other = graph.add(Node("excitation_node", context=graph.context))
    graph.until(lambda: any(event.kind == Event.DUPLICATE for event in graph.events), sine())
    graph.until(lambda: graph.state.mode == ExcitationState.OFF, sine())
    assert not graph.change(Transition.TRANSITION_ACTIVATE)
    other.destroy_node()
    graph.until(lambda: graph.lifecycle == "active", sine())
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


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


class Support:
    """Publishes an estimate of the excitation 20 times a second: the output times a gain, as its quality has it."""

    def __init__(self, graph: Graph, gain: float = 1.0, quality: int = Excitation.STEADY) -> None:
        self.graph, self.gain, self.quality = graph, gain, quality
        self.late = 0.0  # of the stamps [s]
        self.frozen = False
        self.estimate = Excitation(window=0.1)
        self._last = 0.0

    def __call__(self) -> None:
        now, state = time.monotonic(), self.graph.state
        if now - self._last < 0.05:
            return
        self._last = now
        if not self.frozen:
            self.estimate = Excitation(quality=self.quality, amplitude=self.gain * state.amplitude,
                                       frequency=state.frequency, window=0.1)  # fmt: skip
            stamp = self.graph.operator.get_clock().now() - Duration(seconds=self.late)
            self.estimate.header.stamp = stamp.to_msg()
        self.graph.estimates.publish(self.estimate)

    def until(self, condition: Callable[[], object], command: ExcitationCommand) -> None:
        """Go on until something is true."""

        def turned() -> object:
            self()
            return condition()

        self.graph.until(turned, command)

    def holds(self, command: ExcitationCommand) -> None:
        """Wait until the command is held, and what is measured is what was commanded."""
        self.until(lambda: self.graph.state.held, command)
        assert self.graph.state.measured_amplitude == pytest.approx(command.amplitude, rel=0.01)


def test_with_hold_the_identified_amplitude_comes_to_the_command(graph: Graph) -> None:
    """The support moves 0.8 times as far as the calibration has it."""
    graph.start()
    support = Support(graph, 0.8)
    support.holds(sine(hold=True))
    assert 0.8 * graph.state.amplitude == pytest.approx(0.01, rel=0.012)
    # another command begins without the correction of the last one, which may be another drive's
    support.until(lambda: graph.state.sequence == 2, sine(hold=True, amplitude=0.005, sequence=2))
    support.until(lambda: graph.state.mode == ExcitationState.RUNNING, sine(hold=True, amplitude=0.005, sequence=2))
    assert graph.state.amplitude == pytest.approx(0.005, rel=0.05)


@pytest.mark.parametrize("quality", [Excitation.POOR, Excitation.NONE])
def test_an_estimate_that_is_not_to_be_trusted_steers_nothing_and_holds_nothing(graph: Graph, quality: int) -> None:
    graph.start(hold_timeout=1.0)
    support = Support(graph)
    support.holds(sine(hold=True))
    amplitude, support.gain, support.quality = graph.state.amplitude, 0.5, quality
    support.until(lambda: not graph.state.held, sine(hold=True))
    assert math.isnan(graph.state.measured_amplitude)
    seen = len(graph.states)
    support.until(lambda: graph.state.mode == ExcitationState.OFF, sine(hold=True))
    running = [state for state in graph.states[seen:] if state.mode == ExcitationState.RUNNING]
    assert {state.amplitude for state in running} <= {amplitude}
    assert not any(state.held for state in graph.states[seen:])
    graph.stopped("hold: no usable estimate of the excitation for 1 s", sine(hold=True))
    assert graph.state.fault.endswith("excitation_node/rearm arms it again")
    graph.arm()
    support = Support(graph)
    support.holds(sine(hold=True, sequence=2))
    assert not graph.state.fault


@pytest.mark.parametrize("way", ["none comes", "the same again and again", "old ones"])
def test_without_a_fresh_estimate_nothing_is_held_and_the_output_ends(graph: Graph, way: str) -> None:
    graph.start(hold_timeout=3.0)
    support = Support(graph)
    if way == "the same again and again":
        support.late = -600.0  # of a device whose clock is wrong: never old
    support.holds(sine(hold=True))
    support.frozen, support.late = way == "the same again and again", 2.0 if way == "old ones" else 0.0
    turn = graph.until if way == "none comes" else support.until
    turn(lambda: not graph.state.held, sine(hold=True))
    seen = len(graph.states)
    assert graph.state.mode == ExcitationState.RUNNING  # long before it ends
    turn(lambda: graph.state.mode == ExcitationState.OFF, sine(hold=True))
    assert not any(state.held for state in graph.states[seen:])
    graph.stopped("hold: no usable estimate of the excitation for 3 s", sine(hold=True))


def test_one_that_was_never_measured_ends_as_soon(graph: Graph) -> None:
    graph.start(hold_timeout=0.5, stale_timeout=5.0)
    begin = time.monotonic()
    graph.until(lambda: graph.state.mode == ExcitationState.RUNNING, sine(hold=True))
    graph.stopped("hold: no usable estimate", sine(hold=True))
    assert time.monotonic() - begin > 1.0  # five periods of 5 Hz, and its rise
    graph.arm()
    graph.run(sine(sequence=2))
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 40, sine(sequence=2))
    assert graph.state.mode == ExcitationState.RUNNING  # without hold nothing is measured


def test_commands_that_change_do_not_put_off_its_end(graph: Graph) -> None:
    graph.start(hold_timeout=0.5, rise_time=2.0)
    graph.run(sine(hold=True))
    begin, number = time.monotonic(), 2
    while not graph.reported("hold: no usable estimate"):
        assert time.monotonic() - begin < 10.0
        seen = len(graph.states)
        command = sine(hold=True, amplitude=0.01 + 1e-5 * number, sequence=number)
        graph.until(lambda seen=seen: len(graph.states) > seen + 4, command)  # type: ignore[misc]
        number += 1


def test_a_transient_estimate_steers_and_is_not_held(graph: Graph) -> None:
    graph.start()
    support = Support(graph, 0.8, Excitation.TRANSIENT)
    hold = graph.node._hold
    support.until(lambda: hold._within > 2.0 * hold._slow, sine(hold=True))  # a steady one would be held
    seen = len(graph.states)
    support.until(lambda: len(graph.states) > seen + 20, sine(hold=True))
    assert graph.state.amplitude == pytest.approx(0.0125, rel=0.012)
    assert not any(state.held for state in graph.states)
    support.quality = Excitation.STEADY
    support.holds(sine(hold=True))


def test_at_its_limits_the_output_stays_within_them_and_ends_where_the_command_is_missed(graph: Graph) -> None:
    graph.start(saturation_time=0.5)
    command = sine(hold=True, amplitude=0.02)
    support = Support(graph, 0.6)
    support.until(lambda: graph.state.mode == ExcitationState.RUNNING, command)
    support.until(lambda: graph.state.mode == ExcitationState.OFF, command)
    graph.stopped("hold: the output is at its limits for 0.5 s and misses the command", command)
    assert max(state.amplitude for state in graph.states) == 0.02
    assert not any(state.held for state in graph.states)
    graph.arm()
    support = Support(graph, 0.995)  # within the tolerance it is held at the limit
    command = sine(hold=True, amplitude=0.02, sequence=2)
    support.holds(command)
    seen = len(graph.states)
    support.until(lambda: len(graph.states) > seen + 40, command)
    assert graph.state.held
    assert graph.state.amplitude == 0.02


def test_a_correction_at_its_own_limit_ends_it_too(graph: Graph) -> None:
    graph.start(saturation_time=0.5, most_correction=1.1)
    support = Support(graph, 0.5)
    support.until(lambda: graph.state.mode == ExcitationState.RUNNING, sine(hold=True))
    support.until(lambda: graph.state.mode == ExcitationState.OFF, sine(hold=True))
    graph.stopped("hold: the output is at its limits", sine(hold=True))
    assert max(state.amplitude for state in graph.states) == pytest.approx(0.011)


def test_each_field_of_a_command_but_its_stamp_makes_a_decision() -> None:
    fields: dict[str, str] = ExcitationCommand.get_fields_and_field_types()  # type: ignore[attr-defined]
    assert set(fields) == {"header", *DECIDED}


def test_a_stop_while_it_starts_ends_the_start(graph: Graph) -> None:
    graph.start(supervised=True)
    assert graph.call(Trigger, "stop", Trigger.Request()).success
    graph.permits = READY
    graph.until(lambda: graph.node._permit.granted and time.monotonic() - graph.node._duplicates.started > 3.5)
    assert graph.lifecycle == "inactive"
    graph.stays_off(sine())
    graph.arm()
    graph.run(sine(sequence=2))


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lost_output_is_a_latched_fault_and_arming_opens_it_anew(
    graph: Graph, how: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outputs = with_stand_in(tmp_path, monkeypatch)
    graph.start(backend="labjack_stream", calibration="output.yaml", calibration_folder=str(tmp_path),
                library=str(build() / "libLabJackM.so"), lowest_frequency=1.0)  # fmt: skip
    graph.until(lambda: graph.lifecycle == "active")
    sequence = graph.shakes(0)
    drive = graph.node._drive
    assert isinstance(drive, GuardedDrive)
    assert drive._process is not None
    os.kill(drive._process.pid, how)
    graph.until(lambda: graph.state.mode == ExcitationState.FAULT, sine(sequence=sequence))
    assert outputs.between() == 0.0
    assert "switched off" in graph.state.fault
    seen = len(graph.states)
    graph.until(lambda: len(graph.states) > seen + 20, sine(sequence=sequence + 1))
    assert outputs.between() == 0.0
    graph.arm()
    sequence = graph.shakes(sequence + 1)
    graph.until(lambda: abs(outputs.between()) > 0.1, sine(sequence=sequence))


@pytest.mark.parametrize("notices", ["silence", "another commander", "stop", "another stop"])
def test_a_loss_that_is_first_noticed_where_the_output_is_ended_is_a_fault_too(
    graph: Graph, notices: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_stand_in(tmp_path, monkeypatch)
    graph.start(backend="labjack_stream", calibration="output.yaml", calibration_folder=str(tmp_path),
                library=str(build() / "libLabJackM.so"), lowest_frequency=1.0)  # fmt: skip
    graph.until(lambda: graph.lifecycle == "active")
    command = sine(sequence=graph.shakes(0))
    drive = graph.node._drive
    assert isinstance(drive, GuardedDrive)
    assert drive._process is not None
    monkeypatch.setattr(drive, "turn", lambda _now: drive._output)  # which would notice it within 50 ms
    if notices == "another stop":
        assert graph.call(Trigger, "stop", Trigger.Request()).success
    os.kill(drive._process.pid, signal.SIGKILL)
    drive._process.wait()
    if notices == "another stop":
        assert not graph.call(Trigger, "stop", Trigger.Request()).success
    elif notices == "stop":
        assert graph.call(Trigger, "stop", Trigger.Request()).success  # switched off by the node itself
    elif notices == "another commander":
        other = graph.add(Node("intruder", context=graph.context))
        other.create_publisher(ExcitationCommand, "excitation/command", 10)
    graph.until(lambda: graph.state.mode == ExcitationState.FAULT, None if notices == "silence" else command)
    assert graph.lifecycle == "inactive"
    assert "its process has ended; switched off" in graph.state.fault
    if notices != "another commander":
        monkeypatch.undo()
        with_stand_in(tmp_path, monkeypatch)
        graph.arm()
        graph.shakes(command.sequence)


def test_one_that_hangs_is_off_and_stays_off_when_it_goes_on(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outputs = with_stand_in(tmp_path, monkeypatch)
    graph.start(backend="labjack_stream", calibration="output.yaml", calibration_folder=str(tmp_path),
                library=str(build() / "libLabJackM.so"), stale_timeout=20.0)  # fmt: skip
    graph.until(lambda: graph.lifecycle == "active")
    sequence = graph.shakes(0)
    begin = time.monotonic()
    while time.monotonic() - begin < 0.3 or abs(outputs.between()) > 1e-9:  # the node's only thread hangs
        assert time.monotonic() - begin < 60.0
        time.sleep(0.3)
    graph.stopped("no sign of the node", sine(sequence=sequence))
    graph.arm()
    graph.shakes(sequence)


def with_stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Outputs:
    """Return the outputs of the stand-in T7 that nodes made from now on have, calibrated at 0.02 m/V about 2.5 V."""
    Control(folder / "control").close()
    for name, value in environment(build(), ljm_control=folder / "control", ljm_output=folder / "output").items():
        monkeypatch.setenv(name, value)
    (folder / "output.yaml").write_text(
        "channel: drive_amplitude\nsensor: emulated\nserial: none\ndate: 2026-11-24\nsource: definition\nunit: m\n"
        "coefficients: [-0.05, 0.02]\nlimits_volts: [0.0, 5.0]\n"
    )
    return Outputs(folder / "output")


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
