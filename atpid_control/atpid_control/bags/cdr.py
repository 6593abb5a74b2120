# SPDX-License-Identifier: Apache-2.0
"""The few fields a recorder reads of a serialised message, in place: stamp, frame_id and sample indices.

Layout (XCDR1, little-endian, alignment counted after the 4-byte encapsulation header):
stamp.sec int32 at 4, stamp.nanosec uint32 at 8, frame_id length uint32 at 12, its characters with a final zero from 16.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

_HEADER = struct.Struct("<iII")
_LITTLE_ENDIAN = 1


class Header(NamedTuple):
    """A message's std_msgs/Header."""

    stamp_ns: int
    frame_id: str


class BlockShape(NamedTuple):
    """Which scans a SampleBlock holds."""

    first_index: int
    rate: float  # [Hz]
    dropped: int  # since the start of the stream, by the device's count
    scans: int


def header(data: bytes) -> Header:
    """Return stamp and frame_id of a message whose first field is a Header; raise ValueError for a big-endian one."""
    if data[1] & 1 != _LITTLE_ENDIAN:
        raise ValueError("a big-endian message: this recorder reads little-endian CDR only")
    seconds, nanoseconds, length = _HEADER.unpack_from(data, 4)
    return Header(
        seconds * 1_000_000_000 + nanoseconds, bytes(data[16 : 16 + max(0, length - 1)]).decode("utf-8", "replace")
    )


def is_handshake(data: bytes) -> bool:
    """Return the bool after the header of a message whose second field is `bool handshake`."""
    return bool(data[16 + struct.unpack_from("<I", data, 12)[0]])


class _Cursor:
    """Reads a message field by field."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at = data, at

    @classmethod
    def after_handshake(cls, data: bytes) -> _Cursor:
        """Return a cursor behind the fields `header` and `handshake`."""
        return cls(data, 17 + struct.unpack_from("<I", data, 12)[0])

    def read(self, form: str) -> float:
        """Return the next primitive, given by its struct letter."""
        size = struct.calcsize(form)
        self.at = 4 + (self.at - 4 + size - 1) // size * size
        (value,) = struct.unpack_from("<" + form, self.data, self.at)
        self.at += size
        return value  # type: ignore[no-any-return]  # the type is that of the format letter

    def text(self) -> str:
        """Return the next string."""
        length = int(self.read("I"))
        self.at += length
        return bytes(self.data[self.at - length : self.at - 1]).decode("utf-8", "replace") if length else ""

    def skip_strings(self) -> int:
        """Skip a sequence of strings; return how many there were."""
        count = int(self.read("I"))
        for _ in range(count):
            self.text()
        return count

    def skip_doubles(self) -> int:
        """Skip a sequence of float64; return how many there were."""
        count = int(self.read("I"))
        if count:
            self.at = 4 + (self.at - 4 + 7) // 8 * 8 + 8 * count
        return count


def block_shape(data: bytes) -> BlockShape:
    """Return which scans an atpid_interfaces/msg/SampleBlock holds, without decoding its samples."""
    cursor = _Cursor.after_handshake(data)
    first, rate, dropped = int(cursor.read("Q")), float(cursor.read("d")), int(cursor.read("Q"))
    cursor.read("Q")  # backlog
    channels = cursor.skip_strings()
    cursor.skip_strings()  # units
    cursor.skip_doubles()  # skew
    values = cursor.skip_doubles()
    return BlockShape(first, rate, dropped, values // channels if channels else 0)


def truth_shape(data: bytes) -> BlockShape:
    """Return which scans an atpid_interfaces/msg/PlantTruth holds, without decoding its series."""
    cursor = _Cursor.after_handshake(data)
    first, rate = int(cursor.read("Q")), float(cursor.read("d"))
    cursor.at += 8 * 8  # excitation, impacts, energies
    return BlockShape(first, rate, 0, cursor.skip_doubles())


def event_kind(data: bytes) -> str:
    """Return the kind of an atpid_interfaces/msg/Event."""
    cursor = _Cursor.after_handshake(data)
    cursor.read("B")  # severity
    return cursor.text()
