# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node over real DDS: commands, time-outs, permission, services, hostile messages."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import Event, Excitation, ExcitationCommand, ExcitationState, SupervisorState
from excitation_rigs import calibrate_shaker, output_process, stand_in
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.duration import Duration
from rclpy.node import Node
from spun import Apart

from atpid_common.errors import InputError
from atpid_common.testing import repeated_after_a_halt
from atpid_driver.nodes.authority import DISCOVERY_TIME
from atpid_driver.standins import build
from atpid_driver.standins.device import Outputs
from atpid_exciter.excitation.drive import Output
from atpid_exciter.excitation.guarded import GuardedDrive
from atpid_exciter.nodes import excitation_node
from atpid_exciter.nodes.excitation_node import DECIDED, ExcitationNode

pytestmark = repeated_after_a_halt

OFF, RUNNING, FAULT = ExcitationState.OFF, ExcitationState.RUNNING, ExcitationState.FAULT
SIMULATED: dict[str, Any] = {
    "backend": "simulated", "highest_amplitude": 0.02, "lowest_frequency": 1.0, "highest_frequency": 20.0,
    "rise_time": 0.2, "frequency_rate": 20.0, "rate": 50.0,
}  # fmt: skip
#: Between two commands and two states of the supervisor [s]; so many states are looked at for an output.
PERIOD, LOOKS = 0.02, 20


class Graph(Apart):
    def __init__(self) -> None:
        super().__init__("operator")
        self.operator = self.peer
        self.states: list[ExcitationState] = []
        self.events: list[Event] = []
        self.operator.create_subscription(ExcitationState, "excitation/state", self.states.append, 100)
        self.operator.create_subscription(Event, "events", self.events.append, 100)
        self.commands = self.operator.create_publisher(ExcitationCommand, "excitation/command", 10)
        self.supervisor = self.operator.create_publisher(SupervisorState, "supervisor/state", 10)
        self.estimates = self.operator.create_publisher(Excitation, "excitation", 10)
        self.permits: SupervisorState | None = None
        self.usual = dict(SIMULATED)  # parameters of the node

    def start(self, **parameters: Any) -> None:
        self.began = time.monotonic()
        self.make(ExcitationNode, self.usual | parameters)
        self.until(lambda: self.commands.get_subscription_count() and self.states)
        self.until(lambda: self.state.mode != ExcitationState.UNCONFIGURED)

    @property
    def lifecycle(self) -> str:
        return str(self.call("excitation_node/get_state", GetState).current_state.label)

    @property
    def state(self) -> ExcitationState:
        return self.states[-1]

    def until(  # type: ignore[override]
        self, happened: Callable[[], object], command: ExcitationCommand | None = None
    ) -> None:
        due = 0.0

        def command_and_permit() -> None:
            nonlocal due
            if time.monotonic() <= due:
                return
            due = time.monotonic() + PERIOD
            if command is not None:
                command.header.stamp = self.operator.get_clock().now().to_msg()
                self.commands.publish(command)
            if self.permits is not None:
                self.permits.header.stamp = self.operator.get_clock().now().to_msg()
                self.supervisor.publish(self.permits)

        super().until(happened, command_and_permit)

    def pause(self, seconds: float, command: ExcitationCommand | None = None) -> None:
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end, command)

    def look(self, command: ExcitationCommand | None, turn: Callable[[], None] = lambda: None) -> list[ExcitationState]:
        """Return the states that come next, while something is commanded."""
        seen = len(self.states)

        def looked() -> bool:
            turn()
            return len(self.states) > seen + LOOKS

        self.until(looked, command)
        return self.states[seen + 1 :]

    def run(self, command: ExcitationCommand) -> None:
        self.until(lambda: self.state.mode == RUNNING and self.state.sequence == command.sequence, command)

    def shakes(self, sequence: int) -> int:
        """Let it shake by a new command, armed again where this machine halted it meanwhile; return its sequence."""
        while self.state.mode != RUNNING:
            if self.state.fault:
                self.arm()
            sequence += 1
            self.until(lambda: self.state.fault or self.state.mode == RUNNING, sine(sequence=sequence))
        return sequence

    def stays_off(self, command: ExcitationCommand) -> None:
        assert {state.amplitude for state in self.look(command)} == {0.0}

    def stopped(self, command: ExcitationCommand, *why: str) -> None:
        """Wait until the output has been stopped for a reason, which is latched, and the command is void."""
        self.until(lambda: self.state.mode == OFF, command)
        self.until(lambda: self.reported(Event.STOPPED, *why))
        self.events.clear()
        self.stays_off(command)

    def ask(self, name: str) -> Any:
        return self.call(f"excitation_node/{name}")

    def arm(self) -> None:
        """Arm it as a person does; a busy machine may withdraw the permission meanwhile."""
        self.until(lambda: self.ask("rearm").success)

    def change(self, transition: int) -> bool:
        asked = self.call("excitation_node/change_state", ChangeState, transition=Transition(id=transition))
        return bool(asked.success)

    def reported(self, kind: str, *parts: str) -> int:
        """Return how many events of a kind have all of these in their text."""
        return sum(event.kind == kind and all(part in event.text for part in parts) for event in self.events)

    def second_commander(self) -> Node:
        node: Node = self.add(Node("intruder", context=self.context))
        node.create_publisher(ExcitationCommand, "excitation/command", 10)
        return node

    def restart_commander(self) -> None:
        self.commands = self.operator.create_publisher(ExcitationCommand, "excitation/command", 10)
        self.until(self.commands.get_subscription_count)


@pytest.fixture
def graph() -> Iterator[Graph]:
    made = Graph()
    yield made
    made.close()


def sine(**changes: Any) -> ExcitationCommand:
    values = {"kind": ExcitationCommand.SINE, "amplitude": 0.01, "frequency": 5.0, "sequence": 1}
    return ExcitationCommand(**values | changes)


def permitting() -> SupervisorState:
    return SupervisorState(state=SupervisorState.READY, permit=True)


def silent() -> SupervisorState:
    return SupervisorState(state=SupervisorState.FAULT, permit=False, reason="no answer of recorder_node")


def test_a_command_is_put_out_and_its_silence_ends_it(graph: Graph) -> None:
    graph.start(stale_timeout=0.3)
    assert graph.state.mode == OFF
    graph.run(sine())
    assert (graph.state.amplitude, graph.state.frequency, graph.state.sequence) == (0.01, 5.0, 1)
    begin = time.monotonic()
    graph.until(lambda: graph.state.mode == OFF)
    assert time.monotonic() - begin > 0.2
    graph.until(lambda: graph.reported(Event.STALE, "excitation/command"))
    assert graph.state.amplitude == 0.0
    graph.stays_off(sine())  # a commander that goes on is no person
    graph.run(sine(sequence=2))
    graph.until(lambda: graph.state.mode == OFF, ExcitationCommand())
    graph.run(sine(sequence=2))  # OFF and on again are decisions


def test_it_is_off_in_every_state_but_active(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    assert graph.change(Transition.TRANSITION_DEACTIVATE)
    assert graph.state.mode == OFF
    graph.until(lambda: graph.reported(Event.REFUSED, "inactive"), sine())
    assert graph.state.amplitude == 0.0
    assert graph.change(Transition.TRANSITION_ACTIVATE)
    graph.run(sine(sequence=2))
    answer = graph.ask("stop")
    assert answer.success
    assert {"excitation", "off;", "excitation_node/rearm"} <= set(answer.message.split())
    graph.stays_off(sine(sequence=2))
    graph.arm()
    graph.run(sine(sequence=3))
    assert graph.change(Transition.TRANSITION_DEACTIVATE)
    assert graph.change(Transition.TRANSITION_CLEANUP)
    graph.until(lambda: graph.state.mode == ExcitationState.UNCONFIGURED)
    assert graph.state.amplitude == 0.0


def test_it_runs_only_while_the_supervisor_permits(graph: Graph) -> None:
    graph.start(supervised=True)
    graph.stays_off(sine())
    graph.permits = permitting()
    graph.look(sine())
    graph.until(lambda: graph.lifecycle == "active")  # no command is on its way, which would be void by its age
    assert time.monotonic() - graph.began > DISCOVERY_TIME
    graph.stays_off(sine())  # it was commanded before the exciter was armed
    # a command made without permission does not wait for it
    graph.permits = silent()
    graph.until(lambda: not graph.ask("rearm").success)
    graph.events.clear()
    graph.until(lambda: graph.reported(Event.REFUSED, "SINE", silent().reason), sine(sequence=2))
    graph.permits = permitting()
    graph.until(lambda: graph.ask("rearm").success)  # it is armed already
    graph.stays_off(sine(sequence=2))
    graph.run(sine(sequence=3))


@pytest.mark.always("every stop of the exciter is latched")
def test_every_stop_is_latched_until_a_person_arms_it_and_commands_anew(graph: Graph) -> None:
    graph.start(supervised=True)
    graph.permits = permitting()
    graph.until(lambda: graph.lifecycle == "active")
    stop = SupervisorState(state=SupervisorState.SAFE, stop=True, reason="stopped by the operator")
    for number, withdrawn in ((1, silent()), (4, None), (7, stop)):
        graph.run(sine(sequence=number))
        graph.permits = withdrawn
        why = "supervisor is silent" if withdrawn is None else str(withdrawn.reason)
        graph.stopped(sine(sequence=number), why)
        refused = graph.ask("rearm")
        assert not refused.success
        assert why in refused.message
        assert "activate" not in refused.message  # it has not been tried
        graph.permits = permitting()
        graph.stays_off(sine(sequence=number + 1))  # newer than the stop, but not armed
        graph.arm()
        graph.stays_off(sine(sequence=number + 1))  # armed, but older than that
        graph.run(sine(sequence=number + 2))
        assert graph.ask("rearm").success  # it is armed already
        graph.run(sine(sequence=number + 2))


def test_a_stop_while_it_starts_ends_the_start(graph: Graph) -> None:
    graph.start(supervised=True)
    assert graph.ask("stop").success
    graph.permits = permitting()
    graph.pause(graph.began + DISCOVERY_TIME + 0.5 - time.monotonic())
    graph.stays_off(sine())
    assert graph.lifecycle == "inactive"
    graph.arm()
    graph.run(sine(sequence=2))


def test_a_command_that_is_repeated_by_another_publisher_is_a_new_one(graph: Graph) -> None:
    graph.start(stale_timeout=0.3)
    for _ in range(2):
        graph.run(sine())
        graph.until(lambda: graph.state.mode == OFF)
        graph.stays_off(sine())
        graph.operator.destroy_publisher(graph.commands)
        graph.until(lambda: graph.operator.count_publishers("excitation/command") == 0)
        graph.pause(0.5)
        graph.restart_commander()


def test_a_program_that_is_started_again_at_once_and_hangs_is_no_person(graph: Graph) -> None:
    graph.start(stale_timeout=0.3)
    graph.run(sine())
    graph.look(sine())
    graph.look(sine())  # more messages than come from the second one
    graph.operator.destroy_publisher(graph.commands)
    graph.restart_commander()
    graph.until(lambda: graph.reported(Event.REFUSED, "excitation/command"), sine())  # its count begins anew
    graph.until(lambda: graph.state.mode == OFF)
    graph.pause(1.0)  # it hangs
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


def test_what_was_commanded_beside_another_does_not_move_it_once_that_has_left(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    for _ in range(3):
        graph.look(sine())  # more messages than come beside the other one
    intruder = graph.second_commander()
    graph.until(lambda: graph.state.mode == OFF, sine())
    graph.until(lambda: graph.reported(Event.REFUSED, "excitation/command", "/intruder", "/operator"))
    assert not graph.reported(Event.STALE)  # at once, and not after their silence
    graph.operator.destroy_publisher(graph.commands)  # the commander starts again meanwhile
    graph.restart_commander()
    graph.stays_off(sine())
    graph.executor.remove_node(intruder)
    intruder.destroy_node()
    graph.until(lambda: graph.operator.count_publishers("excitation/command") == 1)
    graph.pause(1.5)  # for longer than `stale_timeout`
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


def test_beside_another_of_its_name_it_is_off_and_cannot_be_activated(graph: Graph) -> None:
    graph.start()
    graph.run(sine())
    other = graph.add(Node("excitation_node", context=graph.context))
    graph.until(lambda: graph.reported(Event.DUPLICATE), sine())
    graph.until(lambda: graph.state.mode == OFF, sine())
    assert not graph.change(Transition.TRANSITION_ACTIVATE)
    other.destroy_node()
    graph.until(lambda: graph.lifecycle == "active", sine())
    graph.stays_off(sine())
    graph.run(sine(sequence=2))


def test_a_command_that_waited_too_long_is_ignored(graph: Graph) -> None:
    graph.start(stale_timeout=20.0, command_timeout=0.4)
    graph.run(before := sine())
    late = sine(sequence=2, frequency=6.0)
    late.header.stamp = before.header.stamp  # so that only the times of its publication and receipt show its age
    graph.commands.publish(late)
    time.sleep(0.5)  # the node's only thread hangs
    graph.until(lambda: graph.reported(Event.REFUSED, "0.4 s", "command_timeout"))
    graph.look(sine())
    assert (graph.state.sequence, graph.state.frequency) == (1, 5.0)


def test_a_command_that_may_not_be_followed_is_refused_once_and_the_output_stays(graph: Graph) -> None:
    graph.start(stale_timeout=60.0)
    graph.run(sine())
    random, sweep = ExcitationCommand.RANDOM, ExcitationCommand.SWEEP
    wrong: list[tuple[dict[str, Any], tuple[str, ...]]] = [
        ({"amplitude": 0.05}, ("amplitude", "0.05", "0 to 0.02")),
        ({"amplitude": nan}, ("amplitude", "nan")),
        ({"amplitude": -0.01}, ("amplitude", "-0.01")),
        ({"frequency": 1e300}, ("frequency", "1e+300")),
        ({"kind": 77}, ("kind", "77")),
        ({"kind": random, "end_frequency": 9.0}, ("kind", "RANDOM", "simulated")),
        ({"kind": sweep, "end_frequency": 9.0, "duration": 0.0}, ("duration", " 0;")),
    ]
    for number, (changes, parts) in enumerate(wrong, 2):
        graph.events.clear()
        graph.until(lambda parts=parts: graph.reported(Event.REFUSED, *parts), sine(sequence=number, **changes))  # type: ignore[misc]
        states = graph.look(sine(sequence=number, **changes))
        assert graph.reported(Event.REFUSED) == 1
        assert {(state.amplitude, state.frequency, state.sequence) for state in states} == {(0.01, 5.0, 1)}


def test_each_field_of_a_command_but_its_stamp_makes_a_decision() -> None:
    fields: dict[str, str] = ExcitationCommand.get_fields_and_field_types()  # type: ignore[attr-defined]
    assert set(fields) == {"header", *DECIDED}


class Support:
    """Publishes an estimate of the excitation 20 times a second: the output times a gain, as its quality has it."""

    def __init__(self, graph: Graph, gain: float = 1.0, quality: int = Excitation.STEADY) -> None:
        self.graph, self.gain, self.quality = graph, gain, quality
        self.late = 0.0  # of the stamps [s]
        self.frozen = False
        self.estimate = Excitation()
        self.sent = 0
        self._last = 0.0

    def __call__(self) -> None:
        now, state = time.monotonic(), self.graph.state
        if now - self._last < 0.05:
            return
        self._last = now
        if not self.frozen:
            self.estimate = Excitation(quality=self.quality, amplitude=self.gain * state.amplitude,
                                       frequency=state.frequency, window=0.01)  # fmt: skip
            stamp = self.graph.operator.get_clock().now() - Duration(seconds=self.late)
            self.estimate.header.stamp = stamp.to_msg()
        self.graph.estimates.publish(self.estimate)
        self.sent += 1

    def until(self, condition: Callable[[], object], command: ExcitationCommand) -> None:
        def turned() -> object:
            self()
            return condition()

        self.graph.until(turned, command)

    def look(self, command: ExcitationCommand) -> list[ExcitationState]:
        return self.graph.look(command, self)

    def holds(self, command: ExcitationCommand) -> None:
        """Wait until the command is held, and what is measured is what was commanded."""
        self.until(lambda: self.graph.state.held and self.graph.state.sequence == command.sequence, command)
        assert self.graph.state.measured_amplitude == pytest.approx(command.amplitude, rel=0.01)


def test_with_hold_the_identified_amplitude_comes_to_the_command(graph: Graph) -> None:
    """The support moves 0.8 times as far as the calibration has it; a transient estimate steers and is not held."""
    graph.start()
    support, command = Support(graph, 0.8, Excitation.TRANSIENT), sine(hold=True)
    near = pytest.approx(0.0125, rel=0.008)
    # longer than a steady one has to be near the command until it is held
    support.until(lambda: all(state.amplitude == near for state in graph.states[-100:]), command)
    assert not any(state.held for state in graph.states)
    support.quality = Excitation.STEADY
    assert any(state.held for state in support.look(command))  # at once: nothing else was missing
    support.holds(command)
    assert 0.8 * graph.state.amplitude == pytest.approx(0.01, rel=0.012)
    # another command begins without the correction of the last one, which may be another drive's
    command = sine(hold=True, amplitude=0.005, sequence=2)
    support.until(lambda: graph.state.sequence == 2 and graph.state.mode == RUNNING, command)
    seen, sent = len(graph.states), support.sent
    support.until(lambda: support.sent > sent + 3, command)
    assert 0.005 <= max(state.amplitude for state in graph.states[seen - 1 :]) < 1.15 * 0.005  # was 1.25 times as large


def test_without_a_fresh_estimate_nothing_is_held_and_the_output_ends(graph: Graph) -> None:
    """One that is not to be trusted is none."""
    graph.start(hold_timeout=1.5)
    for number, way in enumerate(("none comes", "old ones", "poor ones", "no tone", "the same again and again")):
        support, command = Support(graph), sine(hold=True, sequence=number)
        if way == "the same again and again":
            support.late = -600.0  # of a device whose clock is wrong: never old
        support.holds(command)
        assert not graph.state.fault
        amplitude = graph.state.amplitude
        support.frozen, support.late = way == "the same again and again", 2.0 if way == "old ones" else 0.0
        if way in ("poor ones", "no tone"):
            support.gain, support.quality = 0.5, Excitation.POOR if way == "poor ones" else Excitation.NONE
        turn = graph.until if way == "none comes" else support.until
        turn(lambda: not graph.state.held, command)
        assert isnan(graph.state.measured_amplitude)
        assert graph.state.mode == RUNNING  # long before it ends
        seen = len(graph.states)
        turn(lambda: graph.state.mode == OFF, command)
        assert {state.amplitude for state in graph.states[seen:] if state.mode == RUNNING} <= {amplitude}
        assert not any(state.held for state in graph.states[seen:])
        graph.stopped(command, "hold", "estimate", " 1.5 s")
        assert "excitation_node/rearm" in graph.state.fault
        graph.arm()


def test_one_that_was_never_measured_ends_as_soon(graph: Graph) -> None:
    graph.start(hold_timeout=0.5, stale_timeout=5.0)
    begin = time.monotonic()
    graph.run(sine(hold=True))
    graph.stopped(sine(hold=True), "hold", "estimate")
    assert time.monotonic() - begin > 1.0  # five periods of 5 Hz, and its rise
    graph.arm()
    graph.run(sine(sequence=2))
    graph.pause(1.2, sine(sequence=2))
    assert graph.state.mode == RUNNING  # without hold nothing is measured
    # commands that change do not put off its end
    graph.run(sine(hold=True, sequence=3))
    number = 4
    while not graph.reported(Event.STOPPED, "hold", "estimate"):
        assert number < 200
        command = sine(hold=True, amplitude=0.01 + 1e-5 * number, sequence=number)
        seen = len(graph.states)
        graph.until(lambda seen=seen: len(graph.states) > seen + 4, command)  # type: ignore[misc]
        number += 1


def test_at_its_limits_the_output_stays_within_them_and_ends_where_the_command_is_missed(graph: Graph) -> None:
    graph.start(saturation_time=0.5, most_correction=1.1)
    missed, near = sine(hold=True, amplitude=0.02), sine(hold=True, amplitude=0.02, sequence=2)
    Support(graph, 0.6).until(lambda: graph.reported(Event.STOPPED), missed)
    graph.stopped(missed, "hold", "limits", "0.5 s")
    assert max(state.amplitude for state in graph.states) == 0.02
    assert not any(state.held for state in graph.states)
    graph.arm()
    support = Support(graph, 0.995)  # within the tolerance it is held at the limit
    support.holds(near)
    for _ in range(2):
        support.look(near)
    assert graph.state.held
    assert graph.state.amplitude == 0.02
    # a correction at its own limit ends it too
    graph.until(lambda: graph.state.mode == OFF, ExcitationCommand())
    graph.states.clear()
    far = sine(hold=True, sequence=3)
    graph.until(lambda: graph.states)
    Support(graph, 0.5).until(lambda: graph.reported(Event.STOPPED), far)
    graph.stopped(far, "hold", "limits", "0.5 s")
    assert max(state.amplitude for state in graph.states) == pytest.approx(0.011)


class Late(GuardedDrive):
    """A drive that notices nothing by its turns while `late`; they would show a lost process within 20 ms."""

    late = False
    last: Output

    def turn(self, now: int, /) -> Output:
        if not self.late:
            self.last = super().turn(now)
        return self.last


@pytest.fixture
def outputs(graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Outputs:
    """What a stand-in T7 puts out, whose stream-out the graph's node uses."""
    calibrate_shaker(tmp_path)
    graph.usual |= {"backend": "labjack_stream", "calibration": "output.yaml", "calibration_folder": str(tmp_path),
                    "library": str(build() / "libLabJackM.so"), "rate": 20.0}  # fmt: skip
    return stand_in(tmp_path, monkeypatch)


def test_a_lost_output_is_latched_and_arming_opens_it_anew(graph: Graph, outputs: Outputs, tmp_path: Path) -> None:
    graph.start()
    sequence = graph.shakes(0)
    for how in (signal.SIGKILL, signal.SIGSTOP):
        os.kill(output_process(tmp_path), how)
        graph.until(lambda: graph.state.mode == FAULT, sine(sequence=sequence))
        assert outputs.between() == 0.0
        assert "DAC0" in graph.state.fault
        graph.look(sine(sequence=sequence + 1))
        assert outputs.between() == 0.0
        graph.arm()
        sequence = graph.shakes(sequence + 1)
        graph.until(lambda: abs(outputs.between()) > 0.1, sine(sequence=sequence))


def test_a_loss_that_is_first_noticed_where_the_output_is_ended_is_a_fault_too(
    graph: Graph, outputs: Outputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Late] = []

    def drive_of(settings: Any, folder: Callable[[], Path]) -> Late:
        made.append(Late(settings, folder()))
        return made[0]

    monkeypatch.setattr(excitation_node, "drive_of", drive_of)
    graph.start()
    sequence = 0
    for notices in ("silence", "stop", "another stop", "another commander"):
        command = sine(sequence=(sequence := graph.shakes(sequence)))
        made[0].late = True
        if notices == "another stop":
            assert graph.ask("stop").success
        process = output_process(tmp_path)
        os.kill(process, signal.SIGKILL)
        os.waitid(os.P_PID, process, os.WEXITED | os.WNOWAIT)
        if notices == "another stop":
            assert not graph.ask("stop").success
        elif notices == "stop":
            assert graph.ask("stop").success  # switched off by the node itself
        elif notices == "another commander":
            graph.second_commander()
        graph.until(lambda: graph.state.mode == FAULT, None if notices == "silence" else command)
        assert graph.lifecycle == "inactive"
        assert {"process", "ended;", "off"} <= set(graph.state.fault.split())
        made[0].late = False
        if notices != "another commander":
            graph.arm()


def test_one_that_hangs_is_off_and_stays_off_when_it_goes_on(graph: Graph, outputs: Outputs) -> None:
    graph.start(stale_timeout=20.0)
    sequence = graph.shakes(0)
    while np.abs(outputs.recent(0.15)[1]).max() > 1e-9:  # the node's only thread hangs
        time.sleep(0.05)
    graph.stopped(sine(sequence=sequence), "no sign", "node")
    graph.arm()
    graph.shakes(sequence)


def test_an_invalid_parameter_is_one_line(graph: Graph) -> None:
    for parameters, parts in (
        ({"backend": "labjack_dac"}, r"calibration"),
        ({"backend": "other"}, r"backend.*other.*simulated"),
        ({"lowest_frequency": 30.0}, r"lowest_frequency 30.*highest_frequency 20"),
        ({"backend": "labjack_stream", "calibration": "x.yaml", "lockstep": True}, r"lockstep.*labjack_stream"),
    ):
        with pytest.raises(InputError, match=parts) as error:
            graph.start(**parameters)
        assert "\n" not in str(error.value)
