# SPDX-License-Identifier: Apache-2.0
"""A session with the firmware: a request, the answer of the same sequence, the request again where none comes."""

import time
from collections.abc import Callable
from typing import Final

from atpid_driver.motor import protocol
from atpid_driver.motor.ceiling_actuator import Limits
from atpid_driver.motor.errors import IdentityError, LimitsError, LinkError, ProtocolError
from atpid_driver.motor.faulty_port import Port

ANSWER_TIME: Final = 0.125
IDENTIFY_TIME: Final = 0.25
# Eight times: a busy host is no lost link. The firmware's heartbeat does not wait, and reopening restarts the board.
ATTEMPTS: Final = 8
VERSION: Final = "1."
SPEED_TOLERANCE: Final = 0.05


class SessionLostError(LinkError):
    """The board was restarted during the session: it must be identified again."""


class Session:
    """One session with the firmware; not safe for threads, one owner only."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._sequence = self.garbled = self.repeated = 0

    def request(self, word: str, *arguments: int) -> protocol.Reply:
        """Return the answer to a command, sent again where none comes: the firmware carries out a repeated frame once.

        Raises `LinkError` if there is none, `SessionLostError` if the board was restarted.
        """
        frame = self._next(word, *arguments)
        for attempt in range(ATTEMPTS):
            self.repeated += attempt > 0
            self._port.write(frame)
            reply = self._answer(ANSWER_TIME)
            if isinstance(reply, protocol.Refusal) and reply.reason == "SESSION":
                raise SessionLostError("the board was restarted: its height is lost until it has homed again")
            if reply is not None:
                return reply
        raise LinkError(f"no answer to {word} within {ATTEMPTS * ANSWER_TIME:g} s")

    def identify(self, timeout: float, cancelled: Callable[[], bool] = lambda: False) -> protocol.IdentityReply:
        """Request the identity until the board answers: opening the port restarts it; its bootloader discards bytes.

        Raises `LinkError` after `timeout` [s] or when `cancelled` returns true.
        """
        end = time.monotonic() + timeout
        while time.monotonic() < end and not cancelled():
            self._port.write(self._next("ID"))
            reply = self._answer(IDENTIFY_TIME)
            if isinstance(reply, protocol.IdentityReply):
                return reply
        raise LinkError(
            f"nothing answers as {protocol.NAME} within {timeout:g} s: is the firmware flashed, the baud rate right?"
        )

    def _next(self, word: str, *arguments: int) -> bytes:
        self._sequence = (self._sequence + 1) % protocol.SEQUENCES
        return protocol.encode(self._sequence, word, *arguments)

    def _answer(self, timeout: float) -> protocol.Reply | None:
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            line = self._port.read_line(left)
            try:
                frame = protocol.decode(line)
                if frame.sequence == self._sequence:
                    return protocol.reply_of(frame)
            except ProtocolError:
                self.garbled += bool(line)
        return None


def check_identity(reply: protocol.IdentityReply, limits: Limits) -> None:
    """Raise `IdentityError` for a firmware that is not supported, `LimitsError` if `limits` are not inside its own."""
    if reply.name != protocol.NAME:
        raise IdentityError(f"{reply.name!r} answers, not {protocol.NAME}: wrong port, or flash atpid_driver/firmware")
    if reply.protocol != protocol.PROTOCOL or not reply.version.startswith(VERSION):
        raise IdentityError(
            f"firmware {reply.version} with protocol {reply.protocol}: this driver needs {VERSION}x with protocol "
            f"{protocol.PROTOCOL}; flash atpid_driver/firmware (make flash)"
        )
    if limits.lowest < reply.lowest - 1e-9 or limits.highest > reply.highest + 1e-9:
        raise LimitsError(
            f"limits {limits.lowest:g} to {limits.highest:g} m asked for, the firmware allows {reply.lowest:g} to "
            f"{reply.highest:g} m: narrow the parameters, or change firmware/config.h and flash"
        )
    if abs(limits.speed - reply.speed) > SPEED_TOLERANCE * reply.speed:
        raise LimitsError(f"speed {limits.speed:g} m/s given, the firmware's is {reply.speed:g} m/s: set speed to it")
