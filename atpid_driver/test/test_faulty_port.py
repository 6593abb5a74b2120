# SPDX-License-Identifier: Apache-2.0
"""A serial line that fails as injected: what passes it, and what the link concludes from it."""

import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from motor_rigs import arm, board, settings, wait_for

from atpid_common.injected_faults import KINDS, Injected
from atpid_driver.emulator import Emulator
from atpid_driver.emulator.storm import storm
from atpid_driver.motor.ceiling_actuator import Mode
from atpid_driver.motor.errors import MotorError
from atpid_driver.motor.faults import Fault
from atpid_driver.motor.faulty_port import FaultyPort
from atpid_driver.motor.protocol import StateReply, decode, encode, reply_of
from atpid_driver.motor.serial_actuator import SerialActuator

FIRST = encode(1, "ST", 3, 1, "0000", 300_000, 300_000, 5283, 1000, 0, 1)
SECOND = encode(2, "ST", 3, 1, "0000", 310_000, 310_000, 5283, 1020, 0, 2)


@dataclass
class Line:
    """A board's end of the line: what arrived, and what it answers."""

    answers: list[bytes]
    arrived: list[bytes] = field(default_factory=list)

    def write(self, data: bytes) -> None:
        self.arrived.append(data)

    def read_line(self, timeout: float) -> bytes:
        if self.answers:
            return self.answers.pop(0)
        time.sleep(timeout)
        return b""

    def close(self) -> None:
        """Close nothing."""


def through(kind: str, value: float = math.nan) -> tuple[Line, FaultyPort, float]:
    """Return a line on which one answer has passed before its fault, and when the next request was made."""
    faults: list[Injected] = []
    line = Line([FIRST])
    port = FaultyPort(line, lambda: faults)
    now = time.monotonic()
    faults.append(Injected("serial_link", kind, now + 1000.0, now + 2000.0, value))
    port.write(b"before")
    assert port.read_line(0.1) == FIRST
    faults[0] = Injected("serial_link", kind, now, now + 1000.0, value)
    line.answers.append(SECOND)
    begun = time.monotonic()
    port.write(b"request")
    return line, port, begun


def test_a_line_without_faults_passes_everything() -> None:
    line = Line([FIRST, SECOND])
    port = FaultyPort(line, lambda: ())
    port.write(b"request")
    assert [port.read_line(0.01) for _ in range(3)] == [FIRST, SECOND, b""]
    assert line.arrived == [b"request"]


@pytest.mark.parametrize("kind", KINDS)
def test_what_passes_a_line_that_fails(kind: str) -> None:
    line, port, begun = through(kind, 0.05 if kind == "delayed" else math.nan)
    answer = port.read_line(0.5)
    took = time.monotonic() - begun
    if kind == "off":
        assert (line.arrived, answer) == ([b"before"], b"")
    elif kind == "stuck":
        assert (line.arrived[-1], answer) == (b"request", FIRST)
    elif kind == "garbage":
        assert len(line.arrived[-1]) == len(b"request")
        assert line.arrived[-1] != b"request"
        assert b"!" not in line.arrived[-1]
        assert len(answer) == len(SECOND)
        assert answer != SECOND
    elif kind == "wrong":
        reply = reply_of(decode(answer))
        assert isinstance(reply, StateReply)
        assert (reply.height, reply.target, reply.uptime) == (0.32, 0.31, 1.02)
    elif kind == "slow":
        assert answer == SECOND
        assert took >= (len(SECOND) + len(b"request")) / 300.0
    elif kind == "delayed":
        assert answer == SECOND
        assert took >= 0.05
    else:  # the first half of a period
        assert answer == SECOND


@pytest.fixture
def actuator(tmp_path: Path) -> Iterator[tuple[SerialActuator, Emulator]]:
    with board(tmp_path, height=0.99, bootloader=0.05, reset_on_open=True) as emulator:
        emulator.pace(1.0)
        made = SerialActuator(settings(tmp_path))
        made.connect(time.monotonic_ns())
        arm(made)
        yield made, emulator
        made.close()


@pytest.mark.slow
def test_a_height_that_the_motor_cannot_have_reached_is_latched(actuator: tuple[SerialActuator, Emulator]) -> None:
    """And a line that is late is reported once; the height it reports is late, the ceiling where it belongs."""
    ceiling, emulator = actuator
    now = time.monotonic()
    ceiling.inject([Injected("serial_link", "delayed", now, now + 1000.0, 0.3)])
    reports: list[str] = []

    def reported(text: str) -> bool:
        ceiling.read(time.monotonic_ns())
        reports.extend(ceiling.reports())
        return any(text in one for one in reports)

    wait_for(lambda: reported("the board answers late"), "late answers reported", state=lambda: str(reports))
    ceiling.inject([])
    wait_for(lambda: reported("again"), "answers in time reported", state=lambda: str(reports))
    arm(ceiling)  # where this process stood still for longer than the heartbeat allows
    turns = itertools.count()

    def reported_impossible() -> bool:
        if (turn := next(turns)) % 50 == 0:  # again where a busy machine read the line too late to judge the step
            now = time.monotonic()
            if turn % 100:
                ceiling.inject([])
                arm(ceiling)  # where the heartbeat was missed again, its latched fault would hide this one
            else:
                ceiling.inject([Injected("serial_link", "wrong", now, now + 1000.0)])
        return reported("which its motor cannot")

    wait_for(reported_impossible, "an impossible height reported", state=lambda: str(reports))
    wait_for(lambda: ceiling.read(time.monotonic_ns()).mode is Mode.FAULT, "the fault latched")
    assert Fault.LINK_LOST in ceiling.read(time.monotonic_ns()).faults
    with pytest.raises(MotorError, match="rearm"):
        ceiling.move(0.5, 1, time.monotonic_ns())
    assert emulator.state().motor == 0


@pytest.mark.slow
def test_the_real_firmware_keeps_its_limits_in_a_storm(tmp_path: Path) -> None:
    with board(tmp_path, height=0.98) as emulator:
        result = storm(emulator, 60.0, 200, seed=1)
    assert result.requests == 200
    assert result.states > 0
