# SPDX-License-Identifier: Apache-2.0
"""The real firmware on the emulated board: what it does when things go wrong, as docs/motor_protocol.md lists it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from motor_rigs import board

from atpid_driver.emulator.client import SteppedHost
from atpid_driver.motor.ceiling_actuator import Mode
from atpid_driver.motor.faults import Fault
from atpid_driver.motor.protocol import IdentityReply, Refusal, StateReply, crc16, encode

MIDDLE = 500_000
RESOLUTION = 1.5e-3


@pytest.fixture
def host(tmp_path: Path) -> Iterator[SteppedHost]:
    """A board that has just been switched on, its ceiling near the top."""
    with board(tmp_path, height=0.98) as emulator:
        yield SteppedHost(emulator)


@pytest.fixture
def ready(host: SteppedHost) -> SteppedHost:
    """Armed and homed."""
    host.make_ready()
    return host


@pytest.fixture
def moving(ready: SteppedHost) -> SteppedHost:
    """On its way down to the middle."""
    ready.request("MOVE", MIDDLE)
    assert ready.beat(0.3).mode is Mode.MOVING
    assert ready.emulator.state().motor == -1
    return ready


def stands_still(host: SteppedHost) -> bool:
    before = host.emulator.state()
    host.emulator.run(0.5)
    after = host.emulator.state()
    return after.motor == 0 and after.travel_um == before.travel_um


def test_after_power_on_it_is_disarmed_and_identifies_itself(host: SteppedHost) -> None:
    assert host.request("STATE") == Refusal("SESSION")
    assert host.request("ID") == IdentityReply("ATPID-MOTOR", "1.1.0", 1, 1, "POWER", 0.017, 1.0, 0.3, 0)
    state = host.state()
    assert (state.mode, state.homed, state.faults) == (Mode.DISARMED, False, Fault(0))


def test_nothing_moves_unless_armed_and_homed(host: SteppedHost) -> None:
    host.request("ID")
    assert host.request("MOVE", MIDDLE) == Refusal("DISARMED")
    assert host.request("HOME") == Refusal("DISARMED")
    host.request("ARM")
    assert host.request("MOVE", MIDDLE) == Refusal("UNHOMED")
    host.request("HOME")
    assert host.request("MOVE", MIDDLE) == Refusal("BUSY")
    assert host.emulator.state().motor == 1, "homing goes up, away from the grain"


def test_homes_from_the_lowest_height(tmp_path: Path) -> None:
    with board(tmp_path, height=0.017) as emulator:
        state = SteppedHost(emulator).make_ready()
        assert state.height == pytest.approx(1.0, abs=RESOLUTION)
        assert emulator.state().height_um == pytest.approx(1e6, abs=1000)


def test_homes_with_a_slipped_sensor(tmp_path: Path) -> None:
    with board(tmp_path, height=0.98) as emulator:
        emulator.set("slip", 15_000)
        host = SteppedHost(emulator)
        assert host.make_ready().height == pytest.approx(1.0, abs=RESOLUTION)
        assert emulator.state().height_um == pytest.approx(1e6, abs=1000)


@pytest.mark.slow
@pytest.mark.parametrize("target", [17_000, 290_000, 999_000])
def test_travels_at_constant_speed_and_stops_at_the_target(ready: SteppedHost, target: int) -> None:
    before = ready.emulator.state()
    ready.request("MOVE", target)
    state = ready.beat(4.0)
    after = ready.emulator.state()
    assert (state.mode, state.faults, state.target) == (Mode.HOLDING, Fault(0), target / 1e6)
    assert state.height == pytest.approx(target / 1e6, abs=RESOLUTION)
    assert after.height_um == pytest.approx(target, abs=1200)
    nominal = abs(before.height_um - target) / 300.0
    assert after.motor_off_ms - before.ms == pytest.approx(nominal, abs=30) or nominal < 10


def test_turns_round_on_a_target_behind_it(moving: SteppedHost) -> None:
    moving.request("MOVE", 990_000)
    state = moving.beat(1.0)
    assert state.mode == Mode.HOLDING
    assert state.height == pytest.approx(0.99, abs=RESOLUTION)


@pytest.mark.parametrize("height", [16_999, 1_000_001, 0, 99_999_999])
def test_soft_limits(ready: SteppedHost, height: int) -> None:
    assert ready.request("MOVE", height) == Refusal("RANGE")
    assert stands_still(ready)


@pytest.mark.parametrize("word", ["STOP", "DISARM", "ID"])
def test_stop_disarm_and_a_new_session_stop_at_once(moving: SteppedHost, word: str) -> None:
    moving.request(word)
    assert moving.state().mode is (Mode.HOLDING if word == "STOP" else Mode.DISARMED)
    assert stands_still(moving)


def test_lost_heartbeat_switches_off_within_500_ms(moving: SteppedHost) -> None:
    moving.emulator.run(1.0)
    truth = moving.emulator.state()
    assert truth.motor == 0
    assert 400.0 < truth.motor_off_ms - truth.last_byte_ms <= 500.0
    state = moving.state()
    assert (state.mode, state.faults) == (Mode.FAULT, Fault.HEARTBEAT)


@pytest.mark.parametrize("flood", [b"$", b"noise ", b"$1,STATE*0000\n", bytes(range(256))])
def test_a_flood_does_not_keep_the_motor_running(moving: SteppedHost, flood: bytes) -> None:
    began = moving.emulator.state().ms
    moving.emulator.send((flood * 25_000)[:25_000])  # one second of the line
    moving.emulator.drain(0.05)
    assert moving.emulator.state().motor_off_ms - began <= 500.0
    moving.emulator.received()
    assert moving.state().faults == Fault.HEARTBEAT


def test_looking_is_no_heartbeat(moving: SteppedHost) -> None:
    for _ in range(12):
        moving.request("STATE", seconds=0.05)
    assert moving.state().faults == Fault.HEARTBEAT
    assert moving.emulator.state().motor == 0


def test_after_a_lost_heartbeat_only_arm_helps(moving: SteppedHost) -> None:
    moving.emulator.run(1.0)
    assert moving.request("MOVE", MIDDLE) == Refusal("FAULT")
    moving.beat(0.5)
    assert stands_still(moving)
    armed = moving.request("ARM")
    assert isinstance(armed, StateReply)
    assert (armed.mode, armed.homed, armed.faults) == (Mode.HOLDING, True, Fault(0))
    assert stands_still(moving), "armed again it does not resume the old travel"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "fault", "within"),
    [
        ("jam", 1, Fault.STALL, 0.32),
        ("swapped", 1, Fault.WRONG_WAY, 0.1),
        ("sensor", "open", Fault.SENSOR_LOW, 0.02),
        ("sensor", "high", Fault.SENSOR_HIGH, 0.02),
        ("sensor", "frozen", Fault.STALL, 0.32),
        ("lower", "open", Fault.LOWER_LIMIT, 0.01),
        ("upper", "open", Fault.UPPER_LIMIT, 0.01),
        ("stop", "open", Fault.EMERGENCY_STOP, 0.01),
    ],
)
def test_breaking_in_motion(moving: SteppedHost, name: str, value: str | int, fault: Fault, within: float) -> None:
    """Motor off within the time given, the fault latched, and it stays so while heartbeats go on."""
    began = moving.emulator.state().ms
    moving.emulator.set(name, value)
    state = moving.beat(0.4)
    assert state.mode is Mode.FAULT
    assert fault in state.faults
    assert moving.emulator.state().motor_off_ms - began < within * 1e3
    assert moving.request("MOVE", 900_000) == Refusal("FAULT")
    assert moving.beat(0.5).faults == state.faults
    assert stands_still(moving)


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("sensor", "open", Fault.SENSOR_LOW),
        ("sensor", "high", Fault.SENSOR_HIGH),
        ("lower", "open", Fault.LOWER_LIMIT),
        ("upper", "open", Fault.UPPER_LIMIT),
        ("stop", "open", Fault.EMERGENCY_STOP),
    ],
)
def test_arm_is_refused_while_the_cause_is_there(moving: SteppedHost, name: str, value: str, fault: Fault) -> None:
    moving.emulator.set(name, value)
    moving.beat(0.1)
    assert moving.request("ARM") == Refusal("FAULT")
    assert fault in moving.state().faults
    moving.emulator.set(name, "ok")
    moving.beat(0.1)
    armed = moving.request("ARM")
    assert isinstance(armed, StateReply)
    assert (armed.mode, armed.faults) == (Mode.HOLDING, Fault(0))
    assert armed.homed is (name != "sensor"), "a sensor that failed has lost its reference"


def test_both_limit_switches(moving: SteppedHost) -> None:
    moving.emulator.set("lower", "open")
    moving.emulator.set("upper", "open")
    assert Fault.BOTH_LIMITS in moving.beat(0.2).faults
    assert stands_still(moving)
    assert moving.request("ARM") == Refusal("FAULT")


@pytest.mark.slow
def test_lower_switch_stops_a_ceiling_whose_sensor_slipped(ready: SteppedHost) -> None:
    ready.request("MOVE", 100_000)
    ready.beat(4.0)
    ready.emulator.set("slip", 6_000)
    ready.request("MOVE", 17_000)
    state = ready.beat(1.0)
    assert state.faults == Fault.LOWER_LIMIT
    assert ready.emulator.state().height_um > 12_100, "stopped before the mechanical end"
    ready.request("ARM")
    ready.request("MOVE", 30_000)
    assert ready.beat(0.3).mode is Mode.HOLDING, "away from the switch it may go"


def test_a_welded_upper_switch_ends_in_a_stall_at_the_mechanical_end(host: SteppedHost) -> None:
    host.emulator.set("upper", "closed")
    for word in ("ID", "ARM", "HOME"):
        host.request(word)
    state = host.beat(1.0)
    assert (state.mode, state.homed, state.faults) == (Mode.FAULT, False, Fault.STALL)


def test_homing_refuses_a_switch_in_the_wrong_place(host: SteppedHost) -> None:
    host.emulator.set("slip", 24_500)
    for word in ("ID", "ARM", "HOME"):
        host.request(word)
    state = host.beat(1.0)
    assert (state.mode, state.homed, state.faults) == (Mode.FAULT, False, Fault.HOMING)


def test_an_upper_switch_that_opens_too_early_is_stuck(host: SteppedHost) -> None:
    for word in ("ID", "ARM", "HOME"):
        host.request(word)
    host.emulator.set("upper", "open")
    state = host.beat(1.0)
    assert (state.mode, state.homed, state.faults) == (Mode.FAULT, False, Fault.UPPER_LIMIT)


def test_a_ceiling_that_moves_by_itself_is_reported(ready: SteppedHost) -> None:
    ready.request("MOVE", MIDDLE)
    ready.beat(2.5)
    ready.emulator.set("runaway", 1)
    assert Fault.UNCOMMANDED in ready.beat(0.3).faults


def test_reset_in_motion(moving: SteppedHost) -> None:
    """Motor off, disarmed, height lost, one boot more; the old session is void."""
    moving.emulator.do("reset")
    assert moving.emulator.state().motor == 0
    moving.emulator.run(0.05)
    assert moving.request("BEAT") == Refusal("SESSION")
    assert stands_still(moving)
    identity = moving.request("ID")
    assert isinstance(identity, IdentityReply)
    assert (identity.boots, identity.reset_cause) == (2, "RESET")
    assert (moving.state().mode, moving.state().homed) == (Mode.DISARMED, False)


def test_power_cycle_in_motion(moving: SteppedHost) -> None:
    """As a reset; the boot counter lives on in the EEPROM."""
    moving.emulator.do("power 0")
    assert moving.emulator.state().motor == 0
    assert stands_still(moving)
    moving.emulator.do("power 1")
    moving.emulator.run(0.05)
    identity = moving.request("ID")
    assert isinstance(identity, IdentityReply)
    assert (identity.boots, identity.reset_cause) == (2, "POWER")
    assert (moving.state().mode, moving.state().homed) == (Mode.DISARMED, False)
    assert stands_still(moving)


def test_watchdog_switches_off_a_hung_firmware(moving: SteppedHost) -> None:
    began = moving.emulator.state().ms
    moving.emulator.do("hang")
    moving.emulator.run(1.0)
    assert 0.0 < moving.emulator.state().motor_off_ms - began < 150.0
    identity = moving.request("ID")
    assert isinstance(identity, IdentityReply)
    assert (identity.boots, identity.reset_cause) == (2, "WATCHDOG")
    assert (moving.state().mode, moving.state().faults) == (Mode.FAULT, Fault.WATCHDOG)
    assert moving.request("HOME") == Refusal("FAULT")


@pytest.mark.parametrize("again", [("reset",), ("power 0", "power 1")])
def test_a_watchdog_restart_stays_latched_over_further_restarts_until_it_is_armed(
    moving: SteppedHost, again: tuple[str, ...]
) -> None:
    """Opening the port resets a board, and the reset flags then name that reset only."""
    moving.emulator.do("hang")
    moving.emulator.run(1.0)
    for command in (*again, *again):
        moving.emulator.do(command)
    moving.emulator.run(0.05)
    identity = moving.request("ID")
    assert isinstance(identity, IdentityReply)
    assert identity.reset_cause != "WATCHDOG"
    assert (moving.state().mode, moving.state().faults) == (Mode.FAULT, Fault.WATCHDOG)
    armed = moving.request("ARM")
    assert isinstance(armed, StateReply)
    assert (armed.mode, armed.homed, armed.faults) == (Mode.HOLDING, False, Fault(0))
    moving.emulator.run(0.05)
    for command in again:
        moving.emulator.do(command)
    moving.emulator.run(0.05)
    moving.request("ID")
    assert moving.state().mode is Mode.DISARMED


def test_a_ceiling_pushed_just_outside_its_limits_holds_a_target_inside_them(ready: SteppedHost) -> None:
    ready.request("MOVE", 1_000_000)
    ready.beat(1.0)
    ready.request("DISARM")
    ready.emulator.set("slip", 3_000)  # less than a fault
    ready.emulator.run(0.05)
    state = ready.request("ARM")
    assert isinstance(state, StateReply)
    assert state.height > 1.0015
    assert (state.mode, state.target) == (Mode.HOLDING, 1.0)
    stopped = ready.request("STOP")
    assert isinstance(stopped, StateReply)
    assert stopped.target == 1.0
    assert stands_still(ready)


def test_a_repeated_frame_is_answered_but_done_once(ready: SteppedHost) -> None:
    move = ready.frame("MOVE", MIDDLE)
    (first,) = ready.answers(move)
    stop = ready.frame("STOP")
    ready.answers(stop)
    (late,) = ready.answers(move)
    assert first.word == "ST"
    assert (late.word, late.arguments) == ("NO", ("OLD",))
    (again,) = ready.answers(stop)
    assert again.word == "ST"
    assert stands_still(ready)


@pytest.mark.parametrize(
    ("word", "arguments", "reason"),
    [
        ("MOVE", (), "ARGUMENT"),
        ("ARM", (1,), "ARGUMENT"),
        ("FLY", (), "COMMAND"),
        ("LOOKUP", (10_000,), "TABLE"),
        ("LOOKUP", (), "ARGUMENT"),
    ],
)
def test_unknown_requests(ready: SteppedHost, word: str, arguments: tuple[int, ...], reason: str) -> None:
    assert ready.request(word, *arguments) == Refusal(reason)
    assert stands_still(ready)


@pytest.mark.parametrize(
    "junk",
    [b"$", b"\n", b"$$$$\n", b"$" + b"9" * 500 + b"\n", b"$1,MOVE,500000*0000\n", bytes(range(256)) * 4, b"!!" * 40],
)
def test_junk_gets_no_answer_and_breaks_nothing(ready: SteppedHost, junk: bytes) -> None:
    assert ready.answers(junk, 0.05) == []
    assert ready.beat(0.1).mode is Mode.HOLDING
    assert stands_still(ready)


@pytest.mark.parametrize(
    "body", [",MOVE,-1", ",MOVE,+1", ",MOVE,0500000", ",MOVE,5e5", ",MOVE,", ",move,500000", ",MOVE,500000,1"]
)
def test_malformed_bodies_with_a_right_check_sum_are_dropped(ready: SteppedHost, body: str) -> None:
    text = f"{ready.sequence + 1}{body}".encode()
    assert ready.answers(b"$%b*%04X\n" % (text, crc16(text))) == []
    assert ready.state().rejected == 1
    assert stands_still(ready)


def test_sequences_wrap_round(ready: SteppedHost) -> None:
    for sequence in (30_000, 60_000, 65_535, 0, 1):
        (answer,) = ready.answers(encode(sequence, "BEAT"))
        assert (answer.sequence, answer.word) == (sequence, "ST")
