# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A host of the emulated board in simulated time: every step is repeatable to the cycle."""

from atpid_driver.emulator.emulator import Emulator
from atpid_driver.motor.faults import ProtocolError
from atpid_driver.motor.protocol import Frame, Reply, StateReply, decode, encode, reply_of

BEAT_TIME = 0.1
BOOT_TIME = 0.05


class SteppedHost:
    """Sends requests and steps simulated time explicitly; there is no port and no thread."""

    def __init__(self, emulator: Emulator) -> None:
        """Disconnect the serial port and let the board start."""
        self.emulator = emulator
        self.sequence = 0
        emulator.do("unplug")
        emulator.run(BOOT_TIME)
        emulator.received()

    def frame(self, word: str, *arguments: int | str) -> bytes:
        """Return the next request's bytes."""
        self.sequence = (self.sequence + 1) % 65536
        return encode(self.sequence, word, *arguments)

    def request(self, word: str, *arguments: int | str, seconds: float = 0.01) -> Reply:
        """Send a command, advance by `seconds`, return the answer. Raises `ProtocolError` if it is not the only one."""
        (answer,) = self.answers(self.frame(word, *arguments), seconds)
        if answer.sequence != self.sequence:
            raise ProtocolError(f"answer {answer.sequence} to request {self.sequence}")
        return reply_of(answer)

    def answers(self, data: bytes, seconds: float = 0.01) -> list[Frame]:
        """Send bytes, advance by `seconds`, return every frame received."""
        self.emulator.send(data)
        self.emulator.drain(seconds)
        return [decode(line) for line in self.emulator.received().splitlines(keepends=True)]

    def state(self) -> StateReply:
        """Return the state without a heartbeat."""
        return self._state("STATE", 0.01)

    def beat(self, seconds: float) -> StateReply:
        """Advance by `seconds` with a heartbeat every 0.1 s; return the last state."""
        for _ in range(max(1, round(seconds / BEAT_TIME)) - 1):
            self.request("BEAT", seconds=BEAT_TIME)
        return self._state("BEAT", BEAT_TIME)

    def make_ready(self) -> StateReply:
        """Identify, arm and home. Raises `ProtocolError` if the board ends up anywhere but at rest and homed."""
        for word in ("ID", "ARM", "HOME"):
            self.request(word)
        for _ in range(100):
            state = self.beat(BEAT_TIME)
            if state.homed:
                return state
        raise ProtocolError(f"homing did not end: {state}")

    def _state(self, word: str, seconds: float) -> StateReply:
        reply = self.request(word, seconds=seconds)
        if not isinstance(reply, StateReply):
            raise ProtocolError(f"{word} was refused: {reply}")
        return reply
