# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The real firmware against harmful frames and on a line that fails; its look-up table and constants."""

import itertools
import random
import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import settings as current_settings
from motor_rigs import SteppedHost, arm, board, need_emulator, settings
from stops_on_a_line import Noise

from atpid_common.injected_faults import KINDS, Injected
from atpid_common.testing import repeated_after_a_halt, wait_for
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError
from atpid_driver.emulator import Emulator, build_firmware
from atpid_driver.emulator.line import FaultyLine, InjectedFaults
from atpid_driver.motor.faults import MotorFault, ProtocolError, StopNotConfirmedError
from atpid_driver.motor.protocol import COMMANDS, PROTOCOL, SEQUENCES, Refusal, StateReply, decode, encode, reply_of
from atpid_driver.motor.serial_actuator import SerialActuator
from atpid_driver.motor.settings import MotorSettings

pytestmark = repeated_after_a_halt

DRIVER = Path(__file__).resolve().parents[2] / "atpid_driver"
FRAMES = 1_000_000 if current_settings.get_current_profile_name() == "long" else 8_000


FRAMES_A_BEAT = 150  # about 0.1 s at 250 kbaud


def flip(frame: bytearray, rng: random.Random) -> bytes:
    for _ in range(rng.randint(1, 4)):
        frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
    return bytes(frame)


def truncate(frame: bytearray, rng: random.Random) -> bytes:
    return bytes(frame[: rng.randrange(1, len(frame) - 1)])


def overwrite(frame: bytearray, rng: random.Random) -> bytes:
    start = rng.randrange(len(frame))
    return bytes(frame[:start]) + rng.randbytes(rng.randint(1, 12)) + bytes(frame[start + 1 :])


def drop(frame: bytearray, rng: random.Random) -> bytes:
    del frame[rng.randrange(len(frame))]
    return bytes(frame)


def digit(frame: bytearray, rng: random.Random) -> bytes:
    """Change a digit, the most dangerous corruption: another height of the same form."""
    digits = [i for i, byte in enumerate(frame) if 48 <= byte <= 57]
    frame[rng.choice(digits)] = rng.randrange(48, 58)
    return bytes(frame)


def garbled(_: bytearray, rng: random.Random) -> bytes:
    return b"$" + rng.randbytes(rng.randint(1, 40))


DAMAGES: tuple[Callable[[bytearray, random.Random], bytes], ...] = (flip, truncate, overwrite, drop, digit, garbled)


def harmful(newest: Callable[[], int], rng: random.Random) -> Iterator[bytes]:
    """Yield frames that must not be carried out: damaged ones, and whole ones that were carried out before."""
    while True:
        if rng.random() < 0.2:
            old = (newest() - rng.randrange(1, 1000)) % SEQUENCES
            yield encode(old, "MOVE", rng.randrange(17_000, 1_000_000))
            continue
        word = rng.choice((*COMMANDS, "MOVE", "MOVE", "MOVE"))
        arguments = (rng.randrange(17_000, 1_000_000),) if word == "MOVE" else ()
        whole = encode((newest() + rng.randrange(1, 1000)) % SEQUENCES, word, *arguments)
        damaged = rng.choice(DAMAGES)(bytearray(whole), rng)
        if not any(is_whole(part) for part in damaged.split(b"$")):
            yield damaged


def is_whole(part: bytes) -> bool:
    """Whether a piece between two dollars is a good frame after all, as one changed digit into itself is."""
    try:
        decode(b"$" + part.split(b"\n")[0])
    except ProtocolError:
        return False
    return True


def fuzz(emulator: Emulator, frames: int, seed: int) -> int:
    """Send harmful frames with good heartbeats between to a homed motor, which stays; return how many were refused."""
    rng, host = random.Random(seed), SteppedHost(emulator)
    host.make_ready()
    host.beat(0.5)
    before, first = emulator.state(), host.state()
    sent = rejected = 0
    while sent < frames:
        batch = list(itertools.islice(harmful(lambda: host.sequence, rng), min(FRAMES_A_BEAT, frames - sent)))
        sent += len(batch)
        emulator.send(b"".join(batch) + b"\n")
        emulator.drain(0.01)
        emulator.received()
        state = host.request("BEAT")
        assert isinstance(state, StateReply)
        assert (state.mode, state.faults) == (Mode.HOLDING, 0), f"after {sent} frames"
        rejected += (state.rejected - first.rejected - rejected) % SEQUENCES
    after = emulator.state()
    assert (after.travel_um, after.switched, after.resets) == (before.travel_um, before.switched, before.resets)
    return rejected


def test_harmful_frames_move_nothing(tmp_path: Path) -> None:
    with board(tmp_path, height=0.98) as emulator:
        assert fuzz(emulator, FRAMES, seed=20) > FRAMES / 2  # the frames did reach the parser
        assert emulator.state().board == "running"


TABLE = """
#include <stdint.h>
#define ATPID_TABLE_N 3
static const uint32_t atpid_amplitude_um[ATPID_TABLE_N] PROGMEM = {10000, 15000, 30000};
static const uint32_t atpid_height_um[ATPID_TABLE_N] PROGMEM = {200000, 290000, 999000};
"""


def test_lookup_takes_the_nearest_amplitude(tmp_path: Path) -> None:
    need_emulator()
    header = tmp_path / "table.h"
    header.write_text(TABLE)
    firmware = build_firmware(header, tmp_path / "build")
    with board(tmp_path, height=0.98, firmware=firmware) as emulator:
        host = SteppedHost(emulator)
        host.make_ready()
        assert host.request("LOOKUP", 9_999) == host.request("LOOKUP", 30_001) == Refusal("RANGE")
        for amplitude, height in ((10_000, 0.2), (12_600, 0.29), (22_499, 0.29), (30_000, 0.999)):
            state = host.request("LOOKUP", amplitude)
            assert isinstance(state, StateReply)
            assert state.target == height


def constants(name: str) -> dict[str, str]:
    """Return the constants of a firmware header by name."""
    text = (DRIVER / "firmware" / name).read_text()
    return dict(re.findall(r"constexpr \w+ (\w+) = ([^;]+);", text))


def test_fault_bits_and_modes_are_the_drivers() -> None:
    bits = {name: int(value.split("<<")[1]) for name, value in constants("faults.h").items() if "<<" in value}
    on_the_wire = {fault.name: fault.value for fault in MotorFault if fault < 1 << 16}
    assert {name: 1 << bit for name, bit in bits.items()} == on_the_wire
    text = (DRIVER / "firmware" / "motion.h").read_text()
    modes = dict(re.findall(r"(\w+) = (\d)", text[text.index("enum class Mode") : text.index("enum class Answer")]))
    assert {name: int(value) for name, value in modes.items()} == {m.name: m.value for m in Mode if m}


def test_parameter_file_fits_the_firmware() -> None:
    figures = constants("config.h")
    given: dict[str, Any] = yaml.safe_load((DRIVER / "config" / "motor_serial.yaml").read_text())
    settings = MotorSettings(**given["/**/motor_node"]["ros__parameters"])
    assert settings.lowest >= int(figures["LOWEST_UM"]) / 1e6
    assert settings.highest <= int(figures["HIGHEST_UM"]) / 1e6
    assert settings.speed == int(figures["SPEED_UM_PER_S"]) / 1e6
    assert settings.baud == int(figures["BAUD"])
    assert int(figures["PROTOCOL_VERSION"]) == PROTOCOL
    given = yaml.safe_load((DRIVER / "config" / "motor.yaml").read_text())
    assert MotorSettings(**given["/**/motor_node"]["ros__parameters"]).backend == "simulated"


FIRST = encode(1, "ST", 3, 1, "0000", 300_000, 300_000, 5283, 1000, 0, 1)
SECOND = encode(2, "ST", 3, 1, "0000", 310_000, 310_000, 5283, 1020, 0, 2)
MOVE = encode(2, "MOVE", 310_000)


@pytest.mark.parametrize("kind", KINDS)
def test_what_passes_a_line_that_fails(kind: str) -> None:
    line = InjectedFaults([Injected("serial_link", kind, 1.0, 1000.0, 0.05 if kind == "delayed" else nan)])
    assert line.passed(SECOND, False, 5.0) == (5.0, SECOND)  # before the first height no time of the run has begun
    assert line.passed(MOVE, True, 0.0) == (0.0, MOVE)
    assert line.passed(FIRST, False, 0.5) == (0.5, FIRST)
    request, answer = line.passed(MOVE, True, 1.0), line.passed(SECOND, False, 1.0)
    if kind == "off":
        assert (request, answer) == (None, None)
        return
    assert request is not None
    assert answer is not None
    if kind in ("slow", "delayed"):
        later = {"slow": (len(MOVE) / 300.0, len(SECOND) / 300.0), "delayed": (0.0, 0.05)}[kind]
        assert (request[1], answer[1]) == (MOVE, SECOND)
        assert (request[0] - 1.0, answer[0] - 1.0) == pytest.approx(later)
    elif kind == "stuck":
        assert (request, answer) == ((1.0, MOVE), (1.0, FIRST))
    elif kind == "garbage":
        assert [len(request[1]), len(answer[1])] == [len(MOVE), len(SECOND)]
        assert [request[1] == MOVE, answer[1] == SECOND, b"!" in request[1] + answer[1]] == [False] * 3
    elif kind == "wrong":
        reply = reply_of(decode(answer[1]))
        assert isinstance(reply, StateReply)
        assert (reply.height, reply.target, reply.uptime) == (0.32, 0.31, 1.02)
    else:  # the first half of a period, and the second
        assert (request, answer) == ((1.0, MOVE), (1.0, SECOND))
        assert line.passed(MOVE, True, 1.4) is None


@dataclass
class Rig:
    """A ceiling behind a line whose disturbance may be changed."""

    actuator: SerialActuator
    emulator: Emulator
    line: FaultyLine

    def under_way(self) -> None:
        """Command a far height, as the loop does, until the motor runs."""

        def runs() -> bool:
            with suppress(DriverError):
                self.actuator.move(0.05, 1, time.monotonic_ns())
                return self.emulator.state().motor != 0
            with suppress(DriverError):  # where this process stood still for longer than the heartbeat allows
                arm(self.actuator)
            return False

        wait_for(runs, "the motor running", state=lambda: f"{self.actuator.read(0)} {self.actuator.reports()}")


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with board(tmp_path, height=0.99) as emulator:
        emulator.pace(1.0)
        with FaultyLine(tmp_path / "line", tmp_path / "board") as line:
            actuator = SerialActuator(settings(tmp_path, port=str(tmp_path / "line")))
            actuator.connect(time.monotonic_ns())
            arm(actuator)
            yield Rig(actuator, emulator, line)
            line.disturbance = InjectedFaults(())
            actuator.close()


LINES = {
    "answers at once": Noise(1),
    "answers late by 16 to 20 ms, as behind a USB chip": Noise(1, delay=(0.016, 0.020)),
    "answers late by 100 ms": Noise(1, delay=(0.1, 0.1)),
    "one in ten lost, one in ten garbled": Noise(1, lost=0.1, garbled=0.1),
    "late, lost and garbled, in both directions": Noise(1, delay=(0.0, 0.1), lost=0.1, garbled=0.1, requests_late=True),
}


@pytest.mark.parametrize("how", ["disarm", "hold"])
@pytest.mark.parametrize("name", LINES)
def test_a_stop_reaches_the_board_whatever_the_line_does(rig: Rig, name: str, how: str) -> None:
    rig.line.disturbance = LINES[name]
    rig.under_way()
    called, before = time.monotonic(), rig.emulator.state()
    if how == "disarm":

        def confirmed() -> bool:
            with suppress(StopNotConfirmedError):  # where this process, and the line with it, stood still
                rig.actuator.deactivate(time.monotonic_ns())
                return True
            return False

        wait_for(confirmed, "a confirmed stop")
        assert rig.emulator.state().motor == 0
    else:
        rig.actuator.move(nan, 2, time.monotonic_ns())
        wait_for(lambda: (rig.actuator.read(0), rig.emulator.state().motor)[1] == 0, "motor off")
    written = [frame for when, frame in list(rig.line.sent) if when >= called]
    words = (b"STOP", b"DISARM", b",ID")  # by which a board that is found again is disarmed
    stops = [place for place, frame in enumerate(written) if any(word in frame for word in words)]
    assert stops[0] <= 1  # at most what was on its way to the line comes first
    assert all(b"MOVE" not in frame for frame in written[stops[0] :])
    # of the board's clock: at the latest by the heartbeat, where this process was held up; tests/test_stops.py is exact
    assert rig.emulator.state().motor_off_ms - before.ms < 500.0


def test_a_stop_that_nothing_confirms_is_an_error(rig: Rig) -> None:
    rig.under_way()
    rig.line.disturbance = Noise(1, lost=1.0)
    with pytest.raises(DriverError, match="confirmed"):
        rig.actuator.deactivate(time.monotonic_ns())
    wait_for(lambda: rig.emulator.state().motor == 0, "the firmware's own heartbeat")


def test_a_height_that_the_motor_cannot_have_reached_is_latched(rig: Rig) -> None:
    """And a line that is late is reported once; the height it reports is late, the ceiling where it belongs."""
    rig.line.disturbance = Noise(1, delay=(0.3, 0.3))
    reports: list[str] = []

    def reported(text: str) -> bool:
        rig.actuator.read(time.monotonic_ns())
        reports.extend(rig.actuator.reports())
        return any(text in line for line in reports)

    wait_for(lambda: reported("late"), "late answers reported", state=lambda: str(reports))
    rig.line.disturbance = Noise(1)
    wait_for(lambda: reported("again"), "answers in time reported", state=lambda: str(reports))
    arm(rig.actuator)  # where this process stood still for longer than the heartbeat allows
    turns = itertools.count()

    def reported_impossible() -> bool:
        if (turn := next(turns)) % 50 == 0:  # again where a busy machine read the line too late to judge the step
            rig.line.disturbance = Noise(1)
            if turn % 100:
                with suppress(DriverError):  # the line's last heights are given up
                    arm(rig.actuator)  # where the heartbeat was missed again, its latched fault would hide this one
            else:
                raised = InjectedFaults([Injected("serial_link", "wrong", 0.0, 1e6)])
                raised.passed(MOVE, True, time.monotonic())  # a run has begun
                rig.line.disturbance = raised
        return reported("cannot")

    wait_for(reported_impossible, "an impossible height reported", state=lambda: str(reports))
    wait_for(lambda: rig.actuator.read(time.monotonic_ns()).mode is Mode.FAULT, "the fault latched")
    assert MotorFault.LINK_LOST in rig.actuator.read(time.monotonic_ns()).faults
    with pytest.raises(DriverError, match=r"rearm|activate"):
        rig.actuator.move(0.5, 1, time.monotonic_ns())
    assert rig.emulator.state().motor == 0
