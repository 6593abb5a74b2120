# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node over real DDS with the simulated ceiling: lockstep, real time, refusals, lifecycle, started twice."""

import re
import signal
import time
from collections.abc import Iterator
from contextlib import closing, nullcontext
from itertools import pairwise
from math import isnan, nan
from typing import Any

import pytest
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, PlantTruth
from builtin_interfaces.msg import Time as TimeMsg
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import GetState
from motor_graph import SIMULATED, Stand, arguments, motor_process
from motor_rigs import words
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from atpid_common.nodes.messages import nanoseconds_of
from atpid_common.nodes.parameters import ParameterError
from atpid_common.nodes.single_instance import StartedTwiceError, claim
from atpid_common.testing import repeated_after_a_halt
from atpid_driver.motor.faults import MotorFault, in_words
from atpid_driver.motor.simulated import SimulatedActuator
from atpid_driver.nodes import authority, motor_node
from atpid_driver.nodes.authority import Freshness
from atpid_driver.nodes.motor_node import MotorNode

pytestmark = repeated_after_a_halt

SECOND = 1_000_000_000
BLOCK = SECOND // 20
LONGER_THAN_THE_TIMEOUT = 0.7  # of commands [s]


@pytest.fixture
def stand() -> Iterator[Stand]:
    with closing(Stand()) as made:
        yield made


def test_in_lockstep_each_command_is_answered_by_one_state_at_its_stamp(stand: Stand) -> None:
    stand.motor(lockstep=True)
    first = stand.handshake()
    assert (first.handshake, first.mode, first.height) == (True, CeilingState.HOLDING, 0.017)
    stand.until_quiet()
    stand.states.clear()
    for k in range(1, 21):
        state = stand.ask(0.317, 0.1 * k)
    heights = [state.height for state in stand.states]
    assert heights == pytest.approx([min(0.317, 0.017 + 0.03 * k) for k in range(20)], abs=1e-14)
    assert (state.mode, state.height, state.sequence) == (CeilingState.HOLDING, 0.317, 1)
    # a state has the height of its command's stamp, and the motion that follows
    state = stand.ask(0.5, 3.0, sequence=3)
    assert (state.mode, state.height, state.target, state.speed) == (CeilingState.MOVING, 0.317, 0.5, 0.3)
    stand.ask(0.6, 3.1)
    state = stand.ask(nan, 3.5, sequence=3)
    assert (state.mode, state.velocity) == (CeilingState.HOLDING, 0.0)
    assert state.height == state.target == pytest.approx(0.467, abs=1e-12)
    stand.until_quiet()
    stamps = [nanoseconds_of(state.header.stamp) for state in stand.states]
    assert stamps == [*(k * SECOND // 10 for k in range(1, 21)), 3 * SECOND, 31 * SECOND // 10, 7 * SECOND // 2]
    # a travel that begins is an event, another target on the way is none
    assert {(event.kind, event.severity) for event in stand.events} == {(Event.MOVED, Event.INFO)}
    assert [(event.value, event.header.stamp) for event in stand.events] == [
        (0.317, TimeMsg(nanosec=SECOND // 10)),
        (0.5, TimeMsg(sec=3)),
    ]
    assert {"0.0170", "0.3170"} <= words(stand.events[0].text)
    # a refused height is reported once
    stand.events.clear()
    for k in range(5):
        refused = stand.ask(0.001, 4.0 + k)
        assert (refused.mode, refused.height) == (CeilingState.HOLDING, state.height)
    stand.until_quiet()
    (event,) = stand.events
    assert (event.kind, event.value) == (Event.REFUSED, 0.001)
    assert {"0.001", "0.017", "1"} <= words(event.text)


def test_faults_are_injected_into_a_running_motor_by_its_parameter(stand: Stand) -> None:
    motor = stand.motor(speed=0.05)
    truth: list[CeilingState] = []
    stand.peer.create_subscription(CeilingState, "ceiling/truth", truth.append, 10)

    def given(*faults: str) -> Any:
        return motor.set_parameters([Parameter("faults", value=list(faults))])[0]

    stand.handshake()
    stand.until(lambda: stand.state.height > 0.02, lambda: stand.command(0.9, 1.0))
    for faults, named in ((("clock off 0 9",), "clock"), (("motor off 0 9", "motor stuck 1 2"), "motor")):
        refused = given(*faults)
        assert not refused.successful
        assert {"faults", named} <= words(refused.reason)
    assert not truth
    before = stand.state.height
    assert given("motor off 0 1000").successful
    stand.until_mode(CeilingState.FAULT, lambda: stand.command(0.9, 1.0))
    stall = in_words(MotorFault.STALL)
    assert (stand.state.faults, stand.state.fault) == (MotorFault.STALL, stall)
    stand.until(lambda: stand.texts(Event.FAULT))
    (alarm,) = (event for event in stand.events if event.kind == Event.FAULT)
    assert (alarm.severity, alarm.text.endswith(stall)) == (Event.ALARM, True)
    ramp = [0.5 + 0.01 * k for k in range(20)]
    stand.until(lambda: not ramp, lambda: stand.command(ramp.pop(0), 1.1))
    assert stand.more_states(5) == {CeilingState.FAULT}
    assert len(stand.texts(Event.REFUSED)) == 1, "whatever the ramp"
    assert before <= stand.state.height < 0.9
    stand.until(lambda: truth and truth[-1].height == stand.state.height)
    assert given("").successful
    assert stand.trigger("rearm").success
    goal = stand.state.height + 0.02
    stand.until(lambda: stand.state.height == pytest.approx(goal, abs=1e-3), lambda: stand.command(goal, 1.0))
    # a sensor that reads another height: the ceiling is not there
    assert given("height_sensor wrong 0 1000").successful
    stand.until_mode(CeilingState.FAULT, lambda: stand.command(goal, 1.0))
    stand.until(lambda: truth[-1].height == pytest.approx(stand.state.height - 0.01, abs=1e-6))


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_simulated_ceiling_stands_where_the_plants_does(stand: Stand, lockstep: bool) -> None:
    stand.motor(lockstep=lockstep, initial_height=nan)
    truth = stand.peer.create_publisher(PlantTruth, "plant/truth", 10)
    stand.until(lambda: truth.get_subscription_count() == 1)
    if not lockstep:
        stand.until_mode(CeilingState.HOMING)
        assert isnan(stand.state.height)
        assert not stand.state.homed
    message = PlantTruth(handshake=True, ceiling=[0.05, 0.2901])
    stand.until(lambda: truth.get_subscription_count() == 0, lambda: truth.publish(message))
    # those from before may still be on their way
    stand.until_mode(CeilingState.HOLDING, lambda: stand.command(nan, 0.0, 0, handshake=True))
    assert (stand.state.homed, stand.state.height) == (True, 0.2901)


def test_lifecycle_by_a_manager(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    """An impossible transition is refused and an exception in one is logged; the node lives on."""
    stand.motor(autostart=False)
    stand.until_mode(CeilingState.UNCONFIGURED)
    with monkeypatch.context() as broken:
        broken.setattr(SimulatedActuator, "connect", lambda self, now: 1 / 0)
        assert not stand.change(Transition.TRANSITION_CONFIGURE)
    state = stand.call("motor_node/get_state", GetState).current_state
    assert state.label == "unconfigured"
    for transition, mode in (
        (Transition.TRANSITION_CONFIGURE, CeilingState.DISARMED),
        (Transition.TRANSITION_ACTIVATE, CeilingState.HOLDING),
        (Transition.TRANSITION_DEACTIVATE, CeilingState.DISARMED),
        (Transition.TRANSITION_CLEANUP, CeilingState.UNCONFIGURED),
    ):
        assert stand.change(transition)
        stand.until_mode(mode)
        if mode == CeilingState.HOLDING:
            for impossible in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP, 250):
                assert not stand.change(impossible)
            assert stand.more_states(5) == {CeilingState.HOLDING}


def test_rearm_arms_it_from_any_lifecycle_state_but_the_last(stand: Stand) -> None:
    stand.motor(autostart=False)
    assert stand.trigger("rearm").success
    stand.until_mode(CeilingState.HOLDING)
    assert stand.trigger("stop").success
    stand.until_mode(CeilingState.DISARMED)
    assert stand.trigger("rearm").success
    stand.until_mode(CeilingState.HOLDING)
    assert stand.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    answer = stand.trigger("rearm")
    assert not answer.success
    assert {"finalized", "start", "again"} <= words(answer.message)
    stand.command(0.5, 1.0)
    stand.until(lambda: stand.texts(Event.REFUSED))
    (refused,) = stand.texts(Event.REFUSED)
    assert refused.endswith(answer.message)
    assert "0.5" in words(refused)


def test_commands_that_stay_away_stop_the_ceiling_where_it_is(stand: Stand) -> None:
    stand.motor(speed=0.01)
    stand.handshake()
    stand.command(0.9, 1.0, sequence=7)
    stand.until(lambda: stand.texts(Event.STALE))
    stale = next(event for event in stand.events if event.kind == Event.STALE)
    assert stale.severity == Event.ALARM
    assert stale.value >= 0.4
    assert {"ceiling/command", f"{stale.value:.2f}", "stopped"} <= words(stale.text)
    stand.until_mode(CeilingState.HOLDING)
    assert 0.017 < stand.state.height < 0.1
    assert (stand.state.velocity, stand.state.sequence) == (0.0, 7)
    stand.until(lambda: any(s.level == DiagnosticStatus.STALE for s in stand.statuses))
    stand.command(0.9, 1.05, sequence=7)
    stand.until_mode(CeilingState.MOVING)
    stand.until(lambda: stand.texts(Event.RESUMED))


def test_before_the_first_command_and_after_a_run_no_commands_are_expected(stand: Stand) -> None:
    longer_than_the_timeout = 35  # states, 50 a second; the time-out is 0.4 s
    stand.motor()
    stand.handshake()
    stand.more_states(longer_than_the_timeout)
    assert not stand.texts(Event.STALE)
    runs = stand.peer.create_publisher(Event, "events", 10)
    stand.until(lambda: runs.get_subscription_count() == 2)
    assert stand.state.header.frame_id == "ceiling"
    stand.until(lambda: stand.texts(Event.MOVED), lambda: stand.command(0.1, 1.0))

    def finish() -> None:
        stand.command(0.1, 1.0)
        runs.publish(Event(kind=Event.FINISHED, header=Header(stamp=TimeMsg(sec=1))))

    stand.until(lambda: len(stand.texts(Event.FINISHED)) > 2, finish)
    stand.more_states(longer_than_the_timeout)
    assert not stand.texts(Event.STALE)
    assert (stand.state.height, stand.state.sequence) == (0.1, 1)


def test_its_statuses_have_standard_names_and_another_quality_of_service_is_an_event(stand: Stand) -> None:
    stand.motor()
    lossy = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    stand.peer.create_publisher(CeilingCommand, "ceiling/command", lossy)
    stand.until(lambda: stand.texts("qos") and len(stand.statuses) >= 4)
    assert {"ceiling/command", "reliability"} <= words(stand.texts("qos")[-1])
    assert {status.name: status.hardware_id for status in stand.statuses} == {
        "motor_node: ceiling motor": "simulated ceiling",
        "motor_node: commands": "none",
        "motor_node: inputs": "none",
        "motor_node: quality of service": "none",
    }


# a second node of its name


def test_while_an_earlier_one_is_there_nothing_arms_it(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither its own start, which is tried again and again, nor a person; and however long the other stays."""
    monkeypatch.setattr(authority, "DISCOVERY_TIME", 60.0)
    stand.motor()
    other = Node("motor_node", context=stand.context)
    stand.until(lambda: stand.events)
    stand.until_mode(CeilingState.DISARMED)
    assert {(event.kind, event.severity) for event in stand.events} == {(Event.DUPLICATE, Event.ALARM)}
    assert isnan(stand.state.target)
    assert not stand.change(Transition.TRANSITION_ACTIVATE)
    monkeypatch.setattr(authority, "DISCOVERY_TIME", 0.0)  # it has passed
    stand.statuses.clear()
    stand.states.clear()
    # longer than the node waits before it tries again: its diagnostics come once a second
    stand.until(lambda: [status.name for status in stand.statuses].count("motor_node: ceiling motor") >= 3)
    assert not stand.change(Transition.TRANSITION_ACTIVATE)
    assert {state.mode for state in stand.states} == {CeilingState.DISARMED}
    other.destroy_node()
    stand.until_mode(CeilingState.HOLDING)


def test_a_later_duplicate_is_reported_but_stops_nothing(stand: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    stand.motor()
    stand.handshake()
    monkeypatch.setattr(authority, "DISCOVERY_TIME", 0.0)
    other = Node("motor_node", context=stand.context)
    stand.until(lambda: stand.events)
    assert (stand.events[0].kind, stand.events[0].severity) == (Event.DUPLICATE, Event.WARNING)
    assert stand.more_states(5) == {CeilingState.HOLDING}
    other.destroy_node()


@pytest.mark.parametrize(
    ("change", "text"), [({}, "/motor_node"), ({"lowest": 2.0}, "0 < lowest"), ({"backend": "steam"}, "'simulated'")]
)
def test_a_name_can_be_claimed_once_and_what_is_wrong_is_one_line_and_status_2(
    change: dict[str, object], text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with nullcontext() if change else claim("/motor_node"):
        if not change:
            with pytest.raises(StartedTwiceError, match="/motor_node"):
                claim("/motor_node")
        assert motor_node.main(["motor_node", *arguments(**SIMULATED | change)]) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert text in line
    claim("/motor_node").close()


def test_limits_have_no_default(stand: Stand) -> None:
    given = [Parameter("backend", value="simulated"), Parameter("lowest", value=0.017)]
    with pytest.raises(ParameterError, match=r"highest\b.*\bmotor_node"):
        MotorNode(parameter_overrides=given, context=stand.context)


# no height from before an interruption moves the ceiling


@given(
    offset=st.integers(-(10**18), 10**18),
    ppm=st.integers(-200, 200),
    jitter=st.lists(st.integers(0, 20_000_000), min_size=100, max_size=100),
    held=st.integers(SECOND // 2, 20 * SECOND),
)
def test_what_waited_is_old_and_what_comes_in_time_is_not(offset: int, ppm: int, jitter: list[int], held: int) -> None:
    fresh, now = Freshness(), 0
    for k, late in enumerate(jitter):
        now = k * BLOCK + k * BLOCK * ppm // 1_000_000 + late
        assert fresh.age(k * BLOCK + offset, now) <= 0.021
    # those of the time in which the loop, or this node, stood still
    woken = now + held
    ages = [fresh.age(k * BLOCK + offset, woken) for k in range(len(jitter), len(jitter) + held // BLOCK)]
    assert ages[0] >= 0.98 * held / SECOND - 0.1
    assert all(later <= earlier for earlier, later in pairwise(ages))
    following = len(jitter) + held // BLOCK
    assert fresh.age(following * BLOCK + offset, woken + BLOCK) <= 0.15


def test_a_source_that_begins_anew_is_not_judged_by_the_one_before() -> None:
    fresh = Freshness()
    assert [fresh.age(stamp, stamp + 5) for stamp in (10, 20, 30)] == [0.0, 0.0, 0.0]
    assert fresh.age(20, 10 * SECOND) == 0.0, "its clock was set back"
    assert fresh.age(20 + SECOND, 16 * SECOND) == pytest.approx(5.0, abs=0.1), "and is judged again from then on"
    assert fresh.age(20 + 2 * SECOND, 30 * SECOND) > 10.0
    fresh.restart()
    assert fresh.age(20 + 3 * SECOND, 44 * SECOND) == 0.0, "its stamps may go on where those of the other were"


def test_a_clock_that_drifts_all_day_makes_no_command_old() -> None:
    fresh = Freshness()
    ages = [fresh.age(k * BLOCK, k * BLOCK + k * BLOCK // 5_000) for k in range(20 * 3600)]
    assert max(ages) < 1e-3, "200 ppm are 0.7 s in an hour"


def test_a_command_is_compared_with_the_time_the_motor_was_armed() -> None:
    fresh = Freshness()
    fresh.armed(10 * SECOND)
    assert fresh.before_armed(0.6, 10 * SECOND + SECOND // 2)
    assert not fresh.before_armed(0.4, 10 * SECOND + SECOND // 2)


def test_a_command_that_waited_too_long_is_ignored(stand: Stand) -> None:
    stand.motor(command_timeout=0.05)
    stand.handshake()
    stand.command(0.5, 1.0, sequence=2)
    time.sleep(0.2)  # the node does not run meanwhile
    stand.until(lambda: stand.events)
    (waited,) = re.findall(r"([\d.]+) s, .* 0.05 s", stand.events[0].text)
    assert float(waited) >= 0.19
    assert stand.more_states(5) == {CeilingState.HOLDING}
    assert stand.state.target == 0.017


def test_what_was_commanded_before_it_was_armed_does_not_move_it(stand: Stand) -> None:
    node = stand.motor(command_timeout=10.0)
    stand.until_mode(CeilingState.HOLDING)
    assert stand.change(Transition.TRANSITION_DEACTIVATE)
    stand.until(lambda: stand.commands.get_subscription_count())
    stand.command(0.5, 1.0, sequence=2)  # it waits in the middleware
    node.trigger_activate()
    stand.until(lambda: any("armed" in text for text in stand.texts(Event.REFUSED)))
    assert not any(state.target == 0.5 for state in stand.states)


def test_after_standing_still_only_a_fresh_height_moves_it(stand: Stand) -> None:
    def stood_still(before: float) -> bool:
        return time.time() - before > LONGER_THAN_THE_TIMEOUT

    def until_refused() -> None:
        stand.until(lambda: any("waited" in text for text in stand.texts(Event.REFUSED)))
        stand.until_moving(0.8, lambda: stand.command(0.8, time.time()))
        assert not any(state.target == 0.9 for state in stand.states)
        stand.events.clear()

    with motor_process(**SIMULATED | {"speed": 0.05}) as motor:
        stand.until_mode(CeilingState.HOLDING)
        stand.until_moving(0.05, lambda: stand.command(0.05, time.time()))
        stand.until_mode(CeilingState.HOLDING, lambda: stand.command(0.05, time.time()))
        stand.events.clear()
        before = time.time()
        stand.until(lambda: stood_still(before))
        for k in range(5):
            stand.command(0.9, before + 0.01 * k)
        until_refused()
        stand.until_mode(CeilingState.HOLDING, lambda: stand.command(nan, time.time()))
        motor.send_signal(signal.SIGSTOP)
        before = time.time()
        stand.command(0.9, before)
        stand.until(lambda: stood_still(before))
        motor.send_signal(signal.SIGCONT)
        until_refused()
