# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the motor's tests share: the emulated board, its host in simulated time, and waiting for events."""

import os
import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from atpid_common.testing import SLOWNESS, wait_for
from atpid_common.vocabulary import Mode
from atpid_driver import DriverError
from atpid_driver.emulator import PACKAGES, Emulator, missing_tools
from atpid_driver.motor.ceiling_actuator import CeilingActuator
from atpid_driver.motor.protocol import Frame, Reply, StateReply, decode, encode, reply_of
from atpid_driver.motor.settings import MotorSettings

SERIAL: dict[str, Any] = {"backend": "serial", "lowest": 0.017, "highest": 1.0, "speed": 0.3}


def need_emulator() -> None:
    """Skip a test, with the reason, where the AVR tools are missing; in CI that is a failure."""
    if missing := missing_tools():
        text = f"left out: the real firmware on the emulated board; missing {', '.join(missing)}: {PACKAGES}"
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(text)


def words(text: str) -> set[str]:
    """Return the words, names and numbers of a message."""
    return set(re.findall(r"[\w./]*\w", text))


def board(folder: Path, **options: Any) -> Emulator:
    """Return the emulated board with its port at folder/board and an EEPROM of its own."""
    need_emulator()
    return Emulator(folder / "board", eeprom=folder / "eeprom", **options)


def running_board(folder: Path, **options: Any) -> Emulator:
    """Return the board with a bootloader, which opening its port restarts, at real pace, its ceiling near the top."""
    given: dict[str, Any] = {"height": 0.99, "bootloader": 0.05, "reset_on_open": True}
    emulator = board(folder, **given | options)
    emulator.pace(1.0)
    return emulator


def settings(folder: Path, **change: Any) -> MotorSettings:
    """Return settings of the serial backend for the board in `folder`."""
    return MotorSettings(
        **SERIAL | {"port": str(folder / "board"), "identify_timeout": min(60.0, 3.0 * SLOWNESS)} | change
    )


def arm(actuator: CeilingActuator) -> None:
    """Arm and home; again where the test's own process stood still for longer than the firmware's heartbeat allows."""

    def ready() -> bool:
        reading = actuator.read(time.monotonic_ns())
        if reading.mode in (Mode.FAULT, Mode.DISARMED):
            with suppress(DriverError):  # the link is being opened again
                actuator.activate(time.monotonic_ns())
        return reading.ready

    actuator.activate(time.monotonic_ns())
    wait_for(ready, "armed and homed", state=lambda: str(actuator.read(time.monotonic_ns())))


class SteppedHost:
    """Sends requests to the board and steps simulated time; there is no port and no thread."""

    def __init__(self, emulator: Emulator) -> None:
        self.emulator, self.sequence = emulator, 0
        emulator.do("unplug")
        emulator.run(0.05)  # it starts
        emulator.received()

    def frame(self, word: str, *arguments: int) -> bytes:
        self.sequence = (self.sequence + 1) % 65536
        return encode(self.sequence, word, *arguments)

    def answers(self, data: bytes, seconds: float = 0.01) -> list[Frame]:
        self.emulator.send(data)
        self.emulator.drain(seconds)
        return [decode(line) for line in self.emulator.received().splitlines(keepends=True)]

    def request(self, word: str, *arguments: int, seconds: float = 0.01) -> Reply:
        (answer,) = self.answers(self.frame(word, *arguments), seconds)
        assert answer.sequence == self.sequence
        return reply_of(answer)

    def accepted(self, word: str, *arguments: int, seconds: float = 0.01) -> StateReply:
        reply = self.request(word, *arguments, seconds=seconds)
        assert isinstance(reply, StateReply), reply
        return reply

    def state(self) -> StateReply:
        return self.accepted("STATE")

    def beat(self, seconds: float) -> StateReply:
        """Advance by `seconds` with a heartbeat every 0.1 s; return the last state."""
        for _ in range(max(1, round(seconds / 0.1))):
            state = self.accepted("BEAT", seconds=0.1)
        return state

    def home(self) -> None:
        for word in ("ID", "ARM", "HOME"):
            self.request(word)

    def make_ready(self) -> StateReply:
        self.home()
        for _ in range(100):
            if (state := self.beat(0.1)).homed:
                return state
        pytest.fail(f"homing did not end: {state}")
