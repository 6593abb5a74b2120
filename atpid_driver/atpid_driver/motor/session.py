# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Requests and answers of one connection to the firmware, without I/O: what is wanted, frames, lines that were read.

One request at a time is outstanding; a new one replaces it. Times are of the steady clock [s].
"""

from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Final

from atpid_driver.motor import protocol
from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.faults import IdentityError, LimitsError, LinkError, ProtocolError

_VERSION: Final = "1."
_SPEED_TOLERANCE: Final = 0.05
#: Answers to so many requests before the last are still accepted, each once.
_WINDOW: Final = 64


class SessionLostError(LinkError):
    """The board was restarted during the session, or another one answers: it must be identified again."""


@dataclass(slots=True)
class MotorRequest:
    """One request: its frame, and when it was first and last written [s]."""

    word: str
    arguments: tuple[int, ...]
    sequence: int
    frame: bytes
    asked: float
    written: float

    @property
    def repeated(self) -> bool:
        """Whether it was written more than once, so that its answer gives no round trip."""
        return self.written > self.asked

    def not_after(self, other: "MotorRequest") -> bool:
        """Whether the board has taken it, or lost it, where it has answered `other`: the line keeps the order."""
        return (other.sequence - self.sequence) % protocol.SEQUENCES < protocol.SEQUENCES // 2


@dataclass(frozen=True, slots=True)
class MotorAnswer:
    """A reply of the board, the request it answers, and whether that is the outstanding one."""

    reply: protocol.Reply
    request: MotorRequest
    outstanding: bool


@dataclass(slots=True)
class Stop:
    """A stop that the board has not confirmed: its word (STOP, DISARM), the command's sequence, since when."""

    word: str
    sequence: int | None
    since: float
    reported: bool = False
    confirmed: "Future[None]" = field(default_factory=Future)


@dataclass(slots=True)
class Arming:
    """Words that are still to be carried out, one after the other, and their outcome."""

    words: list[str]
    refused: protocol.Refusal | None = None  # the reason is in the state that is asked for next
    done: "Future[None]" = field(default_factory=Future)


@dataclass(frozen=True, slots=True)
class Move:
    """A height [µm], the command's sequence, and when it was received; no longer sent after `command_timeout`."""

    target: int
    sequence: int
    received: float

    def asked_by(self, request: MotorRequest) -> bool:
        """Whether `request` was made for this height: it is made again and again until the board answers."""
        return request.word == "MOVE" and request.arguments == (self.target,) and request.asked >= self.received


class MotorSession:
    """Sequence numbers, the outstanding request, and which answer belongs to which request."""

    def __init__(self) -> None:
        self._sequence = self.garbled = self.repeated = 0
        self._waiting: dict[int, MotorRequest] = {}  # requests without an answer by sequence, the oldest first
        self.request: MotorRequest | None = None  # the outstanding one

    @property
    def unanswered(self) -> MotorRequest | None:
        """The first request after the newest one that was answered."""
        return next(iter(self._waiting.values()), None)

    def begin(self, now: float, word: str, *arguments: int) -> bytes:
        """Return the frame of a new request, which replaces the outstanding one."""
        self._sequence = (self._sequence + 1) % protocol.SEQUENCES
        frame = protocol.encode(self._sequence, word, *arguments)
        self.request = self._waiting[self._sequence] = MotorRequest(word, arguments, self._sequence, frame, now, now)
        if len(self._waiting) > _WINDOW:
            del self._waiting[next(iter(self._waiting))]
        return frame

    def forget(self) -> None:
        """Wait for no answer any longer: requests from before the board was identified may have been discarded."""
        self.request = None
        self._waiting.clear()

    def repeat(self, now: float) -> bytes:
        """Return the outstanding request's frame again: the firmware carries out each sequence once."""
        assert self.request is not None
        self.request.written = now
        self.repeated += 1
        return self.request.frame

    def answer(self, line: bytes) -> MotorAnswer | None:
        """Return the answer in `line`; None for a line that is garbled or answers no request that waits."""
        if not line:
            return None
        try:
            frame = protocol.decode(line)
            if frame.sequence not in self._waiting:
                return None
            reply = protocol.reply_of(frame)
        except ProtocolError:
            self.garbled += 1
            return None
        request = self._waiting[frame.sequence]
        for earlier in [earlier for earlier in self._waiting.values() if earlier.not_after(request)]:
            del self._waiting[earlier.sequence]  # the line keeps the order: what is not answered by now is lost
        return MotorAnswer(reply, request, request is self.request)


def check_identity(reply: protocol.IdentityReply, limits: Limits) -> None:
    """Raise `IdentityError` for a firmware that is not supported, `LimitsError` if `limits` are not inside its own."""
    if reply.name != protocol.NAME:
        raise IdentityError(f"{reply.name!r} answers, not {protocol.NAME}: wrong port, or flash atpid_driver/firmware")
    if reply.protocol != protocol.PROTOCOL or not reply.version.startswith(_VERSION):
        raise IdentityError(
            f"firmware {reply.version} with protocol {reply.protocol}: this driver needs {_VERSION}x with protocol "
            f"{protocol.PROTOCOL}; flash atpid_driver/firmware (make flash)"
        )
    if limits.lowest < reply.lowest - 1e-9 or limits.highest > reply.highest + 1e-9:
        raise LimitsError(
            f"limits {limits.lowest:g} to {limits.highest:g} m asked for, the firmware allows {reply.lowest:g} to "
            f"{reply.highest:g} m: narrow the parameters, or change firmware/config.h and flash"
        )
    if abs(limits.speed - reply.speed) > _SPEED_TOLERANCE * reply.speed:
        raise LimitsError(f"speed {limits.speed:g} m/s given, the firmware's is {reply.speed:g} m/s: set speed to it")
