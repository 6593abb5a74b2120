# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frames of the motor protocol, pure: `$<seq>,<WORD>[,<args>]*<CRC16>\\n` (docs/motor_protocol.md).

Everything between `$` and `*` is protected by CRC-16/XMODEM in four upper-case hexadecimal digits.
Lengths on the wire are whole micrometres, so that a frame reads the same in a terminal and in the firmware.
"""

import re
from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import Final

from atpid_common.vocabulary import Mode
from atpid_driver.motor.faults import MotorFault, ProtocolError

PROTOCOL: Final = 1
NAME: Final = "ATPID-MOTOR"
SEQUENCES: Final = 1 << 16
_MAX_REPLY: Final = 96
COMMANDS: Final = ("ID", "STATE", "BEAT", "ARM", "HOME", "MOVE", "LOOKUP", "STOP", "DISARM")
REFUSALS: Final[dict[str, str]] = {
    "COMMAND": "unknown command",
    "ARGUMENT": "argument missing, not a whole number, or too long",
    "OLD": "sequence older than the last one accepted",
    "SESSION": "no session: the board was restarted, identify first",
    "DISARMED": "not armed",
    "UNHOMED": "not homed",
    "BUSY": "homing",
    "FAULT": "a fault is latched or its cause is still there",
    "RANGE": "height outside the firmware's soft limits",
    "TABLE": "no look-up table on board",
}

_FRAME = re.compile(rb"\$([ -)+-~]{1,88})\*([0-9A-F]{4})\r?\n?")
_NUMBER = re.compile(r"0|[1-9][0-9]{0,9}")


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame: sequence number (0 to 65535), its word, its arguments as text."""

    sequence: int
    word: str
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class IdentityReply:
    """Answer to `ID`: lengths [m], speed [m/s], boots since the EEPROM was new, entries in the on-board table."""

    name: str
    version: str
    protocol: int
    boots: int
    reset_cause: str
    lowest: float
    highest: float
    speed: float
    table: int


@dataclass(frozen=True, slots=True)
class StateReply:
    """Answer to every accepted command but `ID`: height and target [m] (NaN: unknown, nowhere), time since boot [s]."""

    mode: Mode
    homed: bool
    faults: MotorFault
    height: float
    target: float
    position_raw: int
    uptime: float
    rejected: int
    sequence: int


@dataclass(frozen=True, slots=True)
class Refusal:
    """Answer to a command the firmware did not carry out: the reason's code, a key of `REFUSALS`."""

    reason: str

    def __str__(self) -> str:
        return REFUSALS.get(self.reason, self.reason)


Reply = IdentityReply | StateReply | Refusal


def crc16(body: bytes) -> int:
    """Return CRC-16/XMODEM of `body`; of b"123456789" it is 0x31C3."""
    return crc_hqx(body, 0)


def encode(sequence: int, word: str, *arguments: int | str) -> bytes:
    """Return the frame's bytes. Raises `ProtocolError` for a sequence outside 0 to 65535."""
    if not 0 <= sequence < SEQUENCES:
        raise ProtocolError(f"sequence {sequence}: must be 0 to {SEQUENCES - 1}")
    body = ",".join((str(sequence), word, *map(str, arguments))).encode("ascii")
    return b"$%b*%04X\n" % (body, crc16(body))


def decode(line: bytes) -> Frame:
    """Return the frame in `line` (line end optional). Raises `ProtocolError` for anything else."""
    match = _FRAME.fullmatch(line)
    if match is None:
        raise ProtocolError(f"not a frame: {line[:_MAX_REPLY]!r}; expected $<seq>,<WORD>[,<args>]*<CRC16>")
    body, given = match.group(1), int(match.group(2), 16)
    if crc16(body) != given:
        raise ProtocolError(f"check sum {given:04X} of {line[:_MAX_REPLY]!r}: computed {crc16(body):04X}")
    sequence, *fields = body.decode("ascii").split(",")
    if not fields or not fields[0]:
        raise ProtocolError(f"frame without a word: {line[:_MAX_REPLY]!r}")
    return Frame(_whole(sequence, SEQUENCES - 1), fields[0], tuple(fields[1:]))


def reply_of(frame: Frame) -> Reply:
    """Return the reply in `frame`. Raises `ProtocolError` if it is none of the firmware's."""
    try:
        return _PARSERS[frame.word](*frame.arguments)
    except (KeyError, TypeError, ValueError) as error:
        raise ProtocolError(f"reply {frame.word},{','.join(frame.arguments)} not understood: {error}") from None


def micrometres(height: float) -> int:
    """Return `height` [m] as the wire's whole micrometres."""
    return round(height * 1e6)


def _whole(text: str, highest: int = 0xFFFFFFFF) -> int:
    if not _NUMBER.fullmatch(text) or int(text) > highest:
        raise ProtocolError(f"{text!r} is not a whole number from 0 to {highest}")
    return int(text)


def _metres(text: str) -> float:
    """Height on the wire: micrometres, negative below the reference; "-" where it is not known."""
    if text == "-":
        return nan
    return -_whole(text[1:]) / 1e6 if text.startswith("-") else _whole(text) / 1e6


def _identity(*arguments: str) -> IdentityReply:
    name, version, protocol, boots, cause, lowest, highest, speed, table = arguments
    lengths = (_metres(lowest), _metres(highest), _metres(speed))
    return IdentityReply(name, version, _whole(protocol), _whole(boots), cause, *lengths, _whole(table))


def _state(*arguments: str) -> StateReply:
    mode, homed, faults, height, target, raw, milliseconds, rejected, sequence = arguments
    return StateReply(
        mode=Mode(_whole(mode)),
        homed=bool(_whole(homed, 1)),
        faults=MotorFault(int(faults, 16)),
        height=_metres(height),
        target=_metres(target),
        position_raw=_whole(raw),
        uptime=_whole(milliseconds) / 1e3,
        rejected=_whole(rejected),
        sequence=_whole(sequence),
    )


_PARSERS: Final[dict[str, Callable[..., Reply]]] = {"ID": _identity, "ST": _state, "NO": Refusal}
