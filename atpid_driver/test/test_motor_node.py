# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node over real DDS with the simulated ceiling: lockstep, real time, refusals, lifecycle, started twice."""

import time
from collections.abc import Callable, Iterator
from math import isnan, nan
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, PlantTruth
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from motor_graph import SIMULATED, Stand
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from atpid_common.nodes.parameters import ParameterError
from atpid_common.nodes.single_instance import StartedTwiceError, claim
from atpid_driver.nodes import motor_node
from atpid_driver.nodes.motor_node import MotorNode


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_a_handshake_is_answered_once_it_is_ready(stand: Stand) -> None:
    stand.motor(lockstep=True)
    state = stand.handshake()
    assert (state.handshake, state.mode, state.height) == (True, CeilingState.HOLDING, 0.017)


@pytest.mark.slow
def test_lockstep_answers_each_command_with_its_stamp(stand: Stand) -> None:
    stand.motor(lockstep=True)
    stand.handshake()
    heights = []
    for k in range(1, 21):
        state = stand.ask(0.317, 0.1 * k, sequence=1)
        assert (state.header.stamp.sec, state.header.stamp.nanosec) == divmod(k * 10**8, 10**9)
        assert len(stand.states) == 1
        heights.append(state.height)
    assert heights == pytest.approx([min(0.317, 0.017 + 0.03 * k) for k in range(20)], abs=1e-14)
    assert (state.mode, state.height, state.sequence) == (CeilingState.HOLDING, 0.317, 1)


def test_lockstep_reports_the_next_motion(stand: Stand) -> None:
    stand.motor(lockstep=True)
    stand.handshake()
    state = stand.ask(0.5, 1.0, sequence=3)
    assert (state.mode, state.height, state.target, state.speed) == (CeilingState.MOVING, 0.017, 0.5, 0.3)
    state = stand.ask(nan, 1.5, sequence=3)
    assert (state.mode, state.velocity) == (CeilingState.HOLDING, 0.0)
    assert state.height == state.target == pytest.approx(0.167, abs=1e-12)


def test_a_refused_height_is_reported_once_and_the_ceiling_stays(stand: Stand) -> None:
    stand.motor(lockstep=True)
    stand.handshake()
    for k in range(5):
        state = stand.ask(0.001, 1.0 + k)
    stand.until(lambda: stand.events)
    assert (state.mode, state.height) == (CeilingState.HOLDING, 0.017)
    assert [(event.kind, event.value) for event in stand.events] == [("refused", 0.001)]
    assert "allowed 0.017 to 1 m" in stand.events[0].text


def test_real_time_publishes_on_its_own_and_travels(stand: Stand) -> None:
    stand.motor(speed=5.0)
    stand.handshake()
    stand.until(lambda: stand.states[-1].header.frame_id == "ceiling")
    stand.command(0.9, 0.0, sequence=7)
    stand.until(lambda: any(state.mode == CeilingState.MOVING for state in stand.states))
    stand.until(lambda: stand.states[-1].height == 0.9, lambda: stand.command(0.9, 0.0, sequence=7))
    assert (stand.states[-1].mode, stand.states[-1].sequence) == (CeilingState.HOLDING, 7)


def test_faults_are_injected_into_a_running_motor_by_its_parameter(stand: Stand) -> None:
    motor = stand.motor()
    truth: list[CeilingState] = []
    stand.peer.create_subscription(CeilingState, "ceiling/truth", truth.append, 10)

    def given(*faults: str) -> Any:
        return motor.set_parameters([Parameter("faults", value=list(faults))])[0]

    stand.handshake()
    stand.until(lambda: stand.states[-1].height > 0.02, lambda: stand.command(0.9, 1.0))
    refused = given("clock off 0 9")
    assert refused.reason == "faults: given clock; allowed: height_sensor, motor, which the simulated motor injects"
    assert "one fault of a part at a time" in given("motor off 0 9", "motor stuck 1 2").reason
    assert not truth
    before = stand.states[-1].height
    assert given("motor off 0 1000").successful
    stand.until(lambda: stand.states[-1].mode == CeilingState.FAULT, lambda: stand.command(0.9, 1.0))
    assert "motor on but the ceiling does not move" in stand.states[-1].fault
    assert before <= stand.states[-1].height < 0.9
    stand.until(lambda: truth and truth[-1].height == stand.states[-1].height)
    assert given("").successful
    assert stand.call(Trigger, "motor_node/rearm", Trigger.Request()).success
    stand.until(lambda: stand.states[-1].height == pytest.approx(0.9, abs=1e-3), lambda: stand.command(0.9, 1.0))
    # a sensor that reads another height: the ceiling is not there
    assert given("height_sensor wrong 0 1000").successful
    stand.until(lambda: stand.states[-1].mode == CeilingState.FAULT, lambda: stand.command(0.9, 1.0))
    stand.until(lambda: truth[-1].height == pytest.approx(stand.states[-1].height - 0.01, abs=1e-6))


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_simulated_ceiling_stands_where_the_plants_does(stand: Stand, lockstep: bool) -> None:
    stand.motor(lockstep=lockstep, initial_height=nan)
    truth = stand.peer.create_publisher(PlantTruth, "plant/truth", 10)
    stand.until(lambda: truth.get_subscription_count() == 1)
    if not lockstep:
        stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.HOMING)
        assert isnan(stand.states[-1].height)
        assert not stand.states[-1].homed
    message = PlantTruth(handshake=True, ceiling=[0.05, 0.2901])
    stand.until(lambda: truth.get_subscription_count() == 0, lambda: truth.publish(message))
    # those from before may still be on their way
    stand.until(
        lambda: stand.states and stand.states[-1].mode == CeilingState.HOLDING,
        lambda: stand.command(nan, 0.0, 0, handshake=True),
    )
    state = stand.states[-1]
    assert (state.mode, state.homed, state.height) == (CeilingState.HOLDING, True, 0.2901)


def test_a_command_that_waited_too_long_is_ignored(stand: Stand) -> None:
    node = stand.motor(lockstep=False, command_timeout=0.05)
    stand.handshake()
    stale = {"received_timestamp": time.time_ns() - 10**9}
    node._on_command(CeilingCommand(header=Header(frame_id="selector_node"), height=0.5, sequence=2), stale)
    stand.until(lambda: stand.events)
    assert "waited 1.00 s, allowed 0.05 s" in stand.events[0].text
    assert node._read().target == 0.017


def reported(stand: Stand, mode: int) -> Callable[[], object]:
    return lambda: stand.states[-1].mode == mode


def test_lifecycle_by_a_manager(stand: Stand) -> None:
    stand.motor(autostart=False)
    stand.until(lambda: stand.states)
    assert stand.states[-1].mode == CeilingState.UNCONFIGURED

    for transition, mode in (
        (Transition.TRANSITION_CONFIGURE, CeilingState.DISARMED),
        (Transition.TRANSITION_ACTIVATE, CeilingState.HOLDING),
        (Transition.TRANSITION_DEACTIVATE, CeilingState.DISARMED),
        (Transition.TRANSITION_CLEANUP, CeilingState.UNCONFIGURED),
    ):
        assert stand.change(transition)
        stand.until(reported(stand, mode))


def test_an_impossible_transition_is_refused_and_the_node_lives_on(stand: Stand) -> None:
    node = stand.motor()
    stand.handshake()
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP, 250):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert not stand.call(ChangeState, "motor_node/change_state", request).success
    assert node._active


def test_an_exception_in_a_transition_is_logged_and_the_node_lives_on(stand: Stand, monkeypatch: Any) -> None:
    node = stand.motor(autostart=False)
    monkeypatch.setattr(node._actuator, "connect", lambda now: 1 / 0)
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    assert not stand.call(ChangeState, "motor_node/change_state", request).success
    state = stand.call(GetState, "motor_node/get_state", GetState.Request()).current_state
    assert state.label == "unconfigured"
    monkeypatch.undo()
    assert stand.call(ChangeState, "motor_node/change_state", request).success


def test_after_shutdown_nothing_impossible_is_advised(stand: Stand) -> None:
    stand.motor()
    stand.handshake()
    stand.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    answer = stand.call(Trigger, "motor_node/rearm", Trigger.Request())
    final = "the motor node is finalized: it was shut down for good; start it again"
    assert (answer.success, answer.message) == (False, final)
    stand.command(0.5, 1.0)
    stand.until(lambda: stand.events)
    assert [event.text for event in stand.events] == [f"ceiling height 0.5 m refused: {final}"]


def test_commands_that_stay_away_stop_the_ceiling_where_it_is(stand: Stand) -> None:
    stand.motor(speed=0.01)
    stand.handshake()
    stand.command(0.9, 1.0, sequence=7)
    stand.until(lambda: "stale" in stand.kinds())
    stale = next(event for event in stand.events if event.kind == Event.STALE)
    assert stale.severity == Event.ALARM
    assert stale.value >= 0.4
    assert stale.text == f"no message on ceiling/command for {stale.value:.2f} s: the ceiling is stopped"
    stand.until(lambda: stand.states[-1].mode == CeilingState.HOLDING)
    assert 0.017 < stand.states[-1].height < 0.1
    assert (stand.states[-1].velocity, stand.states[-1].sequence) == (0.0, 7)
    stand.until(lambda: any(s.level == DiagnosticStatus.STALE for s in stand.statuses))
    stand.command(0.9, 1.05, sequence=7)
    stand.until(lambda: stand.states[-1].mode == CeilingState.MOVING)
    stand.until(lambda: "resumed" in stand.kinds())


@pytest.mark.slow
def test_before_the_first_command_and_after_a_run_no_commands_are_expected(stand: Stand) -> None:
    node = stand.motor(stale_timeout=60.0)
    stand.handshake()
    runs = stand.peer.create_publisher(Event, "events", 10)
    stand.until(lambda: runs.get_subscription_count() == 2)
    assert not node._supervision.stale.running
    stand.command(0.5, 1.0)
    stand.until(lambda: node._supervision.stale.running)
    runs.publish(Event(kind=Event.FINISHED))
    stand.until(lambda: not node._supervision.stale.running)
    stand.until(lambda: stand.states[-1].height == 0.5)


@pytest.mark.slow
def test_a_travel_that_begins_is_an_event_and_another_target_on_the_way_is_none(stand: Stand) -> None:
    stand.motor(lockstep=True)
    stand.handshake()
    for k, height in enumerate([0.317, 0.317, 0.4, 0.4]):
        stand.ask(height, 1.0 + 0.1 * k)
    stand.until(lambda: stand.events)
    (moved,) = stand.events
    assert (moved.kind, moved.severity, moved.value) == (Event.MOVED, Event.INFO, 0.317)
    assert moved.text == "the ceiling moves from 0.0170 to 0.3170 m"
    assert (moved.header.stamp.sec, moved.header.stamp.nanosec) == (1, 0)
    stand.ask(0.4, 5.0)
    stand.ask(0.2, 5.1)
    stand.until(lambda: len(stand.events) == 2)
    assert stand.events[1].value == 0.2


@pytest.mark.slow
def test_its_statuses_have_standard_names_and_a_hardware_id(stand: Stand) -> None:
    stand.motor()
    stand.until(lambda: len(stand.statuses) >= 4)
    assert {status.name: status.hardware_id for status in stand.statuses} == {
        "motor_node: ceiling motor": "simulated ceiling",
        "motor_node: commands": "none",
        "motor_node: inputs": "none",
        "motor_node: quality of service": "none",
    }


def test_a_command_of_another_quality_of_service_is_an_event(stand: Stand) -> None:
    stand.motor()
    lossy = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    stand.peer.create_publisher(CeilingCommand, "ceiling/command", lossy)
    stand.until(lambda: "qos" in stand.kinds())
    assert "ceiling/command: a publisher has another reliability" in stand.events[-1].text


def test_rearm_arms_it_from_any_lifecycle_state_but_the_last(stand: Stand) -> None:
    stand.motor(autostart=False)
    assert stand.call(Trigger, "motor_node/rearm", Trigger.Request()).success
    stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.HOLDING)
    assert stand.call(Trigger, "motor_node/stop", Trigger.Request()).success
    stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.DISARMED)
    assert stand.call(Trigger, "motor_node/rearm", Trigger.Request()).success
    stand.until(lambda: stand.states and stand.states[-1].mode == CeilingState.HOLDING)
    assert stand.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    answer = stand.call(Trigger, "motor_node/rearm", Trigger.Request())
    assert (answer.success, "start it again" in answer.message) == (False, True)


@pytest.mark.slow
def test_a_duplicate_that_was_there_before_keeps_the_motor_off_until_it_is_gone(stand: Stand) -> None:
    node = stand.motor()
    stand.handshake()
    other = Node("motor_node", context=stand.context)
    stand.until(lambda: stand.states[-1].mode == CeilingState.DISARMED and stand.events)
    assert [event.kind for event in stand.events] == [Event.DUPLICATE]
    assert not node._active
    assert isnan(stand.states[-1].target)
    other.destroy_node()
    stand.until(lambda: stand.states[-1].mode == CeilingState.HOLDING)


@pytest.mark.slow
def test_a_duplicate_that_comes_later_is_reported_but_stops_nothing(stand: Stand) -> None:
    node = stand.motor()
    stand.handshake()
    node._duplicates.started -= 60.0
    other = Node("motor_node", context=stand.context)
    stand.until(lambda: stand.events)
    assert "this one stays" in stand.events[0].text
    assert node._active
    other.destroy_node()


def test_a_name_can_be_claimed_once() -> None:
    with claim("/stand/motor_node"), pytest.raises(StartedTwiceError, match="/stand/motor_node is already running"):
        claim("/stand/motor_node")
    claim("/stand/motor_node").close()


def arguments(**parameters: object) -> list[str]:
    pairs = [f"{key}:={value}" for key, value in parameters.items()]
    return ["motor_node", "--ros-args", *(word for pair in pairs for word in ("-p", pair))]


def test_started_twice_is_one_line_and_exit_2(capfd: pytest.CaptureFixture[str]) -> None:
    with claim("/motor_node"):
        assert motor_node.main(arguments(**SIMULATED)) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line.startswith("error: /motor_node is already running")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"lowest": 2.0}, "0 < lowest < highest"),
        ({"backend": "steam"}, "allowed: 'simulated', 'serial'"),
        ({"rate": 1.0}, "rate"),
    ],
)
def test_bad_parameters_are_one_line_and_exit_2(
    change: dict[str, object], text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert motor_node.main(arguments(**SIMULATED | change)) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert text in line


def test_limits_have_no_default(stand: Stand) -> None:
    with pytest.raises(ParameterError, match="highest of motor_node is not given: highest ceiling height"):
        MotorNode(
            parameter_overrides=[Parameter("backend", value="simulated"), Parameter("lowest", value=0.017)],
            context=stand.context,
        )
