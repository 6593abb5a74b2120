# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The real firmware on the emulated board: what it does when things go wrong, as docs/motor_protocol.md lists it."""

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from motor_rigs import SteppedHost, board, need_emulator

from atpid_common.errors import BAD_INPUT
from atpid_common.vocabulary import Mode
from atpid_driver.emulator.emulator import EEPROM_SIZE, Emulator, EmulatorError
from atpid_driver.motor.faults import MotorFault
from atpid_driver.motor.protocol import IdentityReply, Refusal, StateReply, crc16, encode

MIDDLE = 500_000
RESOLUTION = 1.5e-3
#: Of the true height after homing [um]: it ends where the reading is STOP_LEAD_UM above the highest height, and from
#: switch or height to reading and motor pass a step (1 ms) and a sum (1.7 ms), at 300 um/ms.
HOMED = 1000 + 300 * (1.0 + 1.7)
LONG = settings.get_current_profile_name() == "long"


@pytest.fixture
def host(tmp_path: Path) -> Iterator[SteppedHost]:
    """A board that has just been switched on, its ceiling near the top."""
    with board(tmp_path, height=0.98) as emulator:
        yield SteppedHost(emulator)


@pytest.fixture
def ready(host: SteppedHost) -> SteppedHost:
    host.make_ready()
    return host


@pytest.fixture
def moving(ready: SteppedHost) -> SteppedHost:
    """On its way down to the middle."""
    ready.request("MOVE", MIDDLE)
    assert ready.beat(0.3).mode is Mode.MOVING
    assert ready.emulator.state().motor == -1
    return ready


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SteppedHost]:
    """Armed and homed, for the tests of what changes nothing."""
    with board(tmp_path_factory.mktemp("shared"), height=0.98) as emulator:
        host = SteppedHost(emulator)
        host.make_ready()
        yield host


@pytest.fixture
def standing(shared: SteppedHost) -> SteppedHost:
    """Ready, whatever the test before has found."""
    shared.request("ARM")
    state = shared.beat(0.1)
    assert (state.mode, state.homed) == (Mode.HOLDING, True)
    return shared


def identity(host: SteppedHost) -> IdentityReply:
    reply = host.request("ID")
    assert isinstance(reply, IdentityReply), reply
    return reply


def off_by(state: StateReply, fault: MotorFault, *, homed: bool = False) -> bool:
    return (state.mode, state.homed, state.faults) == (Mode.FAULT, homed, fault)


def stands_still(host: SteppedHost) -> bool:
    """Whether it does so for a while; a motor that reverses pauses for 50 ms only."""
    before = host.emulator.state()
    host.emulator.run(0.25)
    after = host.emulator.state()
    return after.motor == 0 and after.travel_um == before.travel_um


def test_after_power_on_it_is_disarmed_and_identifies_itself(host: SteppedHost) -> None:
    assert host.request("STATE") == Refusal("SESSION")
    assert host.request("ID") == IdentityReply("ATPID-MOTOR", "1.1.1", 1, 1, "POWER", 0.017, 1.0, 0.3, 0)
    state = host.state()
    assert (state.mode, state.homed, state.faults) == (Mode.DISARMED, False, MotorFault(0))


def test_nothing_moves_unless_armed_and_homed(host: SteppedHost) -> None:
    host.request("ID")
    assert host.request("MOVE", MIDDLE) == host.request("HOME") == Refusal("DISARMED")
    host.request("ARM")
    assert host.request("MOVE", MIDDLE) == Refusal("UNHOMED")
    host.request("HOME")
    assert host.request("MOVE", MIDDLE) == Refusal("BUSY")
    assert host.emulator.state().motor == 1, "homing goes up, away from the grain"


@pytest.mark.parametrize(("start", "slip"), [(0.017, 0), (0.98, -20_000), (0.98, 15_000), (0.98, 20_000)])
def test_homes_with_a_slipped_sensor(tmp_path: Path, start: float, slip: int) -> None:
    """Either way, from any height: it then leaps where the switch gives the reference, which is no motion."""
    with board(tmp_path, height=start) as emulator:
        emulator.set("slip", slip)
        host = SteppedHost(emulator)
        assert host.make_ready().height == pytest.approx(1.0, abs=RESOLUTION)
        assert emulator.state().height_um == pytest.approx(1e6, abs=HOMED)


@pytest.mark.parametrize("target", [17_000, 290_000, 999_000])
def test_travels_at_constant_speed_and_stops_at_the_target(ready: SteppedHost, target: int) -> None:
    before = ready.emulator.state()
    nominal = abs(before.height_um - target) / 300.0
    ready.request("MOVE", target)
    state = ready.beat(nominal / 1000.0 + 0.5)
    after = ready.emulator.state()
    assert (state.mode, state.faults, state.target) == (Mode.HOLDING, MotorFault(0), target / 1e6)
    assert state.height == pytest.approx(target / 1e6, abs=RESOLUTION)
    assert after.height_um == pytest.approx(target, abs=1200)
    assert after.motor_off_ms - before.ms == pytest.approx(nominal, abs=30) or nominal < 10


def test_before_a_reversal_the_motor_is_off_for_its_pause(moving: SteppedHost) -> None:
    """On a target behind it, where it then goes."""
    moving.emulator.send(moving.frame("MOVE", 990_000))
    directions = []
    while moving.emulator.state().motor != 1:
        directions.append(moving.emulator.state().motor)
        moving.emulator.run(0.001)
        assert len(directions) < 100
    assert directions[0] == -1
    assert 49 <= directions.count(0) <= 52
    moving.emulator.received()
    state = moving.beat(1.0)
    assert state.mode == Mode.HOLDING
    assert state.height == pytest.approx(0.99, abs=RESOLUTION)


@pytest.mark.parametrize(("word", "start", "nominal"), [("MOVE", 0.98, 1000.0), ("HOME", 0.017, 1010e3 / 300.0)])
def test_a_motor_that_is_slower_than_half_its_speed_is_off_after_the_time_that_the_way_may_take(
    tmp_path: Path, word: str, start: float, nominal: float
) -> None:
    """Not so slow as to be a stall; and the height is known still, as far as it was."""
    with board(tmp_path, height=start) as emulator:
        host = SteppedHost(emulator)
        if word == "MOVE":
            emulator.set("height", host.make_ready().height * 1e6)
        else:
            host.request("ID")
            host.request("ARM")
        emulator.set("speed", 110_000)
        began = emulator.state().ms
        host.request(word, *([700_000] if word == "MOVE" else []))
        while emulator.state().motor:
            host.request("BEAT", seconds=0.05)
        assert off_by(host.state(), MotorFault.OVERTIME, homed=word == "MOVE")
        assert emulator.state().motor_off_ms - began == pytest.approx(2.0 * nominal + 500.0, abs=20.0)


@pytest.mark.parametrize(("target", "slip"), [(1_000_000, 6_500), (18_000, -7_000)])
def test_outside_its_soft_limits_it_is_off_and_has_to_home_again(ready: SteppedHost, target: int, slip: int) -> None:
    """As after a slip while it stands: less than what counts as a motion."""
    ready.request("MOVE", target)
    ready.beat(abs(1_000_000 - target) / 300e3 + 0.5)
    ready.emulator.set("slip", slip / 2)
    assert ready.beat(0.2).mode is Mode.HOLDING
    ready.emulator.set("slip", slip)
    assert off_by(ready.beat(0.2), MotorFault.SOFT_LIMIT)
    assert ready.request("MOVE", MIDDLE) == Refusal("FAULT")
    assert stands_still(ready)


@pytest.mark.parametrize(
    ("word", "arguments", "reason"),
    [
        *(("MOVE", (height,), "RANGE") for height in (16_999, 1_000_001, 0, 99_999_999)),
        ("MOVE", (), "ARGUMENT"),
        ("ARM", (1,), "ARGUMENT"),
        ("FLY", (), "COMMAND"),
        ("LOOKUP", (10_000,), "TABLE"),
        ("LOOKUP", (), "ARGUMENT"),
    ],
)
def test_soft_limits(standing: SteppedHost, word: str, arguments: tuple[int, ...], reason: str) -> None:
    """And other requests that cannot be carried out."""
    assert standing.request(word, *arguments) == Refusal(reason)
    assert stands_still(standing)


@pytest.mark.parametrize("word", ["STOP", "DISARM", "ID"])
def test_stop_disarm_and_a_new_session_stop_at_once(moving: SteppedHost, word: str) -> None:
    moving.request(word)
    assert moving.state().mode is (Mode.HOLDING if word == "STOP" else Mode.DISARMED)
    assert stands_still(moving)


def test_lost_heartbeat_switches_off_within_500_ms(moving: SteppedHost) -> None:
    """And only arming helps, which does not resume the old travel."""
    moving.emulator.run(0.6)
    truth = moving.emulator.state()
    assert truth.motor == 0
    assert 400.0 < truth.motor_off_ms - truth.last_byte_ms <= 500.0
    assert off_by(moving.state(), MotorFault.HEARTBEAT, homed=True)
    assert moving.request("MOVE", MIDDLE) == Refusal("FAULT")
    moving.beat(0.2)
    assert stands_still(moving)
    armed = moving.accepted("ARM")
    assert (armed.mode, armed.homed, armed.faults) == (Mode.HOLDING, True, MotorFault(0))
    assert stands_still(moving)


@pytest.mark.parametrize("flood", [b"$", b"noise ", b"$1,STATE*0000\n", bytes(range(256))])
def test_a_flood_does_not_keep_the_motor_running(moving: SteppedHost, flood: bytes) -> None:
    began = moving.emulator.state().ms
    moving.emulator.send((flood * 15_000)[:15_000])  # 0.6 s of the line
    moving.emulator.drain(0.05)
    assert moving.emulator.state().motor_off_ms - began <= 500.0
    moving.emulator.received()
    assert moving.state().faults == MotorFault.HEARTBEAT


@pytest.mark.parametrize("word", ["STATE", "FLY"])
def test_looking_is_no_heartbeat_and_neither_is_an_unknown_word(moving: SteppedHost, word: str) -> None:
    for _ in range(12):
        moving.request(word, seconds=0.05)
    assert moving.state().faults == MotorFault.HEARTBEAT
    assert moving.emulator.state().motor == 0


@pytest.mark.parametrize(
    ("name", "value", "fault", "within"),
    [
        ("jam", 1, MotorFault.STALL, 0.32),
        ("swapped", 1, MotorFault.WRONG_WAY, 0.1),
        ("sensor", "open", MotorFault.SENSOR_LOW, 0.02),
        ("sensor", "high", MotorFault.SENSOR_HIGH, 0.02),
        ("sensor", "frozen", MotorFault.STALL, 0.32),
        ("lower", "open", MotorFault.LOWER_LIMIT, 0.01),
        ("upper", "open", MotorFault.UPPER_LIMIT, 0.01),
        ("stop", "open", MotorFault.EMERGENCY_STOP, 0.01),
    ],
)
def test_breaking_in_motion(moving: SteppedHost, name: str, value: str | int, fault: MotorFault, within: float) -> None:
    """Motor off within the time given, the fault latched, and it stays so while heartbeats go on.

    It is not armed while a cause is there that shows at rest; what puts the sensor in doubt loses the reference.
    """
    began = moving.emulator.state().ms
    moving.emulator.set(name, value)
    state = moving.beat(0.4)
    assert state.mode is Mode.FAULT
    assert fault in state.faults
    assert moving.emulator.state().motor_off_ms - began < within * 1e3
    assert moving.request("MOVE", 900_000) == Refusal("FAULT")
    assert moving.beat(0.2).faults == state.faults
    assert stands_still(moving)
    if value in ("open", "high"):
        assert moving.request("ARM") == Refusal("FAULT")
        assert fault in moving.state().faults
    moving.emulator.set(name, "ok" if isinstance(value, str) else 0)
    moving.beat(0.1)
    armed = moving.accepted("ARM")
    assert (armed.mode, armed.faults) == (Mode.HOLDING, MotorFault(0))
    assert armed.homed is (name not in ("sensor", "swapped"))


def test_both_limit_switches(moving: SteppedHost) -> None:
    for name in ("lower", "upper"):
        moving.emulator.set(name, "open")
    assert MotorFault.BOTH_LIMITS in moving.beat(0.2).faults
    assert stands_still(moving)
    assert moving.request("ARM") == Refusal("FAULT")


def test_lower_switch_stops_a_ceiling_whose_sensor_slipped(ready: SteppedHost) -> None:
    ready.request("MOVE", 100_000)
    ready.beat(3.3)
    ready.emulator.set("slip", 6_000)
    ready.request("MOVE", 17_000)
    state = ready.beat(1.0)
    assert state.faults == MotorFault.LOWER_LIMIT
    assert ready.emulator.state().height_um > 12_100, "stopped before the mechanical end"
    ready.request("ARM")
    ready.request("MOVE", 30_000)
    assert ready.beat(0.3).mode is Mode.HOLDING, "away from the switch it may go"


def test_upper_switch_that_opens_on_the_way_up_stops_it(ready: SteppedHost) -> None:
    """Above where the ceiling cannot touch it; away from it the ceiling may go."""
    ready.request("MOVE", 960_000)
    ready.beat(0.3)
    ready.request("MOVE", 1_000_000)
    while ready.emulator.state().motor != 1:
        ready.request("BEAT")
    ready.emulator.set("upper", "open")
    state = ready.beat(0.2)
    assert off_by(state, MotorFault.UPPER_LIMIT, homed=True)
    assert ready.emulator.state().height_um < 970_000
    ready.request("ARM")
    ready.request("MOVE", 955_000)
    assert ready.beat(0.3).faults == MotorFault(0)


@pytest.mark.parametrize(("slip", "fault"), [(0, MotorFault.STALL), (24_500, MotorFault.HOMING)])
def test_a_welded_upper_switch_ends_at_the_mechanical_end_or_where_the_switch_cannot_be(
    host: SteppedHost, slip: int, fault: MotorFault
) -> None:
    host.emulator.set("upper", "closed")
    host.emulator.set("slip", slip)
    host.home()
    assert off_by(host.beat(0.6), fault)


@pytest.mark.parametrize("early", [True, False])
def test_an_upper_switch_that_does_not_close_again_ends_homing_within_30_mm(host: SteppedHost, early: bool) -> None:
    """As one does that opens too early, before homing has come to its place."""
    host.home()
    while not early and host.emulator.state().motor != -1:
        host.request("BEAT")
    host.emulator.set("upper", "open")
    assert off_by(host.beat(0.5), MotorFault.UPPER_LIMIT)
    if not early:
        assert host.emulator.state().height_um == pytest.approx(1_010_000 - 30_000, abs=HOMED)


@pytest.mark.parametrize("slip", [-24_500, 24_500])
def test_homing_refuses_a_switch_in_the_wrong_place(host: SteppedHost, slip: int) -> None:
    host.emulator.set("slip", slip)
    host.home()
    assert off_by(host.beat(0.5), MotorFault.HOMING)


def test_a_reading_that_leaps_further_than_the_ceiling_can_move_has_lost_its_reference(ready: SteppedHost) -> None:
    ready.emulator.set("slip", -13_000)
    assert off_by(ready.beat(0.2), MotorFault.SENSOR_JUMP)


def test_a_ceiling_that_moves_by_itself_is_reported(ready: SteppedHost) -> None:
    ready.request("MOVE", MIDDLE)
    ready.beat(2.0)
    ready.emulator.set("runaway", 1)
    assert MotorFault.UNCOMMANDED in ready.beat(0.3).faults


@pytest.mark.parametrize(("commands", "cause"), [(("reset",), "RESET"), (("power 0", "power 1"), "POWER")])
def test_reset_in_motion(moving: SteppedHost, commands: tuple[str, ...], cause: str) -> None:
    """Motor off, disarmed, height lost, one boot more, which the EEPROM counts; the old session is void."""
    for command in commands:
        moving.emulator.do(command)
        assert moving.emulator.state().motor == 0
        assert stands_still(moving)
    assert moving.request("BEAT") == Refusal("SESSION")
    found = identity(moving)
    assert (found.boots, found.reset_cause) == (2, cause)
    assert (moving.state().mode, moving.state().homed) == (Mode.DISARMED, False)
    assert stands_still(moving)


@pytest.mark.parametrize(("hang", "after", "within"), [("hang", 120.0, 130.0), ("hang off", 250.0, 258.0)])
def test_watchdog_switches_off_a_hung_firmware(moving: SteppedHost, hang: str, after: float, within: float) -> None:
    """By its interrupt, or by its second time-out where interrupts are off."""
    began = moving.emulator.state().ms
    moving.emulator.do(hang)
    moving.emulator.run(0.4)
    assert after < moving.emulator.state().motor_off_ms - began < within
    found = identity(moving)
    assert (found.boots, found.reset_cause) == (2, "WATCHDOG")
    assert (moving.state().mode, moving.state().faults) == (Mode.FAULT, MotorFault.WATCHDOG)
    assert moving.request("HOME") == Refusal("FAULT")


@pytest.mark.parametrize("hang", ["hang", "hang off"])
def test_the_watchdog_sees_a_firmware_that_hangs_wherever_it_was(ready: SteppedHost, hang: str) -> None:
    """Asleep, at work, or in an interrupt: 12 instants, 0.29 ms apart, are more than three of its steps of 1 ms."""
    for instant in range(60 if LONG else 12):
        ready.emulator.set("height", MIDDLE)
        ready.emulator.run(0.01)
        ready.home()
        ready.emulator.run(0.06 + 0.00029 * instant)  # it begins with the pause of a reversal
        assert ready.emulator.state().motor == 1
        ready.emulator.do(hang)
        ready.emulator.run(0.27)
        assert ready.emulator.state().motor == 0
        ready.emulator.run(0.05)


def restart(host: SteppedHost, *commands: str) -> None:
    host.emulator.run(0.05)
    for command in commands:
        host.emulator.do(command)
    host.emulator.run(0.05)


@pytest.mark.parametrize("again", [("reset",), ("power 0", "power 1")])
def test_a_watchdog_restart_stays_latched_over_further_restarts_until_it_is_armed(
    moving: SteppedHost, again: tuple[str, ...]
) -> None:
    """Opening the port resets a board, and the reset flags then name that reset only."""
    moving.emulator.do("hang")
    moving.emulator.run(0.4)
    restart(moving, *again, *again)
    assert identity(moving).reset_cause != "WATCHDOG"
    assert (moving.state().mode, moving.state().faults) == (Mode.FAULT, MotorFault.WATCHDOG)
    armed = moving.accepted("ARM")
    assert (armed.mode, armed.homed, armed.faults) == (Mode.HOLDING, False, MotorFault(0))
    restart(moving, *again)
    moving.request("ID")
    assert moving.state().mode is Mode.DISARMED


def test_a_ceiling_pushed_just_outside_its_limits_holds_a_target_inside_them(ready: SteppedHost) -> None:
    ready.request("MOVE", 1_000_000)
    ready.beat(0.3)
    ready.request("DISARM")
    ready.emulator.set("slip", 3_000)  # less than a fault
    ready.emulator.run(0.05)
    state = ready.accepted("ARM")
    assert state.height > 1.0015
    assert (state.mode, state.target) == (Mode.HOLDING, 1.0)
    assert ready.accepted("STOP").target == 1.0
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
    for sequence in (30_000, 60_000, 65_535, 0, 1):  # they wrap round
        (answer,) = ready.answers(encode(sequence, "BEAT"))
        assert (answer.sequence, answer.word) == (sequence, "ST")


def test_a_repeated_arm_does_not_arm_again(ready: SteppedHost) -> None:
    """As a frame that the line delivers twice, after what has happened since."""
    arm = ready.frame("ARM")
    ready.answers(arm)
    ready.emulator.run(0.6)
    (again,) = ready.answers(arm)
    assert again.word == "ST"
    assert (ready.state().mode, ready.state().faults) == (Mode.FAULT, MotorFault.HEARTBEAT)


@pytest.mark.parametrize(
    "junk",
    [b"$", b"\n", b"$$$$\n", b"$" + b"9" * 500 + b"\n", b"$1,MOVE,500000*0000\n", bytes(range(256)) * 4, b"!!" * 40],
)
def test_junk_gets_no_answer_and_breaks_nothing(standing: SteppedHost, junk: bytes) -> None:
    assert standing.answers(junk, 0.05) == []
    assert standing.beat(0.1).mode is Mode.HOLDING
    assert stands_still(standing)


@pytest.mark.parametrize(
    "body", [",MOVE,-1", ",MOVE,+1", ",MOVE,0500000", ",MOVE,5e5", ",MOVE,", ",move,500000", ",MOVE,500000,1"]
)
def test_malformed_bodies_with_a_right_check_sum_are_dropped(standing: SteppedHost, body: str) -> None:
    before = standing.state().rejected
    text = f"{standing.sequence + 1}{body}".encode()
    assert standing.answers(b"$%b*%04X\n" % (text, crc16(text))) == []
    assert standing.state().rejected == before + 1
    assert stands_still(standing)


#: Of the storm, a million requests of any number.
STORM = "4000000 5 2"


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that all runs are built in, once."""
    return tmp_path_factory.mktemp("firmware")


@pytest.mark.parametrize("run", ["", "11400000 99", STORM])  # the second once left a target outside the limits
def test_every_rule_holds_for_random_requests_and_faults(build: Path, run: str) -> None:
    """Under the compiler's address and undefined-behaviour checks."""
    firmware = Path(__file__).resolve().parents[1] / "firmware"
    command = ["make", "-C", str(firmware), "check", f"BUILD={build}", f"RUN={run}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-2 if "Leaving" in done.stdout else -1]
    assert last.split()[-1] == "held"
    assert run != STORM or int(last.split()[0]) > 1_000_000


# what is in the way of its port and its EEPROM: a file of the user is never replaced

IN_THE_WAY: dict[str, Callable[[Path], object]] = {
    "a file": lambda path: path.write_text("mine"),
    "a folder": Path.mkdir,
    "a link to a file": lambda path: path.symlink_to(__file__),
    "no folder": lambda path: path.parent.rmdir(),
}


def seen(path: Path) -> tuple[int, ...] | None:
    """Return what changes with a file; None where there is none."""
    if not os.path.lexists(path):
        return None
    found = os.lstat(path)
    return found.st_mode, found.st_ino, found.st_size, found.st_mtime_ns


@pytest.mark.parametrize("option", ["--link", "--eeprom"])
@pytest.mark.parametrize("kind", IN_THE_WAY)
def test_what_is_in_the_way_is_refused_in_one_line_and_stays(tmp_path: Path, option: str, kind: str) -> None:
    need_emulator()
    path = tmp_path / "folder" / "it"
    path.parent.mkdir()
    IN_THE_WAY[kind](path)
    before = seen(path)
    places: dict[str, Any] = {"link": tmp_path / "port"} | {option.strip("-"): path}
    with pytest.raises(EmulatorError, match=f"^{option} {path}: .+$") as refused:
        Emulator(**places)
    assert refused.value.status == BAD_INPUT
    assert seen(path) == before


def test_what_a_killed_emulator_left_behind_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "board").symlink_to("/dev/pts/99")
    (tmp_path / "eeprom").write_bytes(bytes(EEPROM_SIZE))
    with board(tmp_path) as emulator:
        assert (tmp_path / "board").is_symlink()
        assert emulator.state().board
    assert not (tmp_path / "board").is_symlink()
    assert (tmp_path / "eeprom").stat().st_size == EEPROM_SIZE


def test_a_file_that_took_the_ports_place_stays(tmp_path: Path) -> None:
    with board(tmp_path) as emulator:
        (tmp_path / "board").unlink()
        (tmp_path / "board").write_text("mine")
        emulator.do("unplug")
        with pytest.raises(EmulatorError):
            emulator.do("plug")
    assert (tmp_path / "board").read_text() == "mine"
