# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The few fields a recorder reads of a serialised message: the stamp in place, the others decoded.

Layout (XCDR1, little-endian, alignment counted after the 4-byte encapsulation header):
stamp.sec int32 at 4, stamp.nanosec uint32 at 8.
"""

import struct
from functools import cache
from typing import Any, NamedTuple

from mcap.records import Schema

from atpid_control.runs.decode import Decoder
from atpid_control.runs.definitions import message_type
from atpid_control.runs.errors import BagError, MessageError
from atpid_control.runs.topics import BLOCK, EVENT, TRUTH

_STAMP = struct.Struct("<iI")
_LITTLE_ENDIAN = 1


class Sent(NamedTuple):
    """What kind of Event it is, and the node that published it."""

    kind: str
    node: str


class BlockShape(NamedTuple):
    """Which scans a SampleBlock holds."""

    first_index: int
    rate: float  # [Hz]
    scans: int


def stamp(data: bytes) -> int:
    """Return the stamp [ns] of a message whose first field is a Header; raise MessageError for a big-endian one."""
    if data[1] & 1 != _LITTLE_ENDIAN:
        raise MessageError("it is big-endian; this recorder reads little-endian CDR only")
    seconds, nanoseconds = _STAMP.unpack_from(data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def block_shape(data: bytes) -> BlockShape:
    """Return which scans an atpid_interfaces/msg/SampleBlock holds; raise MessageError for an invalid one."""
    block = _decoded(BLOCK, data)
    values, channels = len(block.data), len(block.channels)
    if not channels or values % channels:
        raise MessageError(f"{values} values for {channels} channels")
    return BlockShape(block.first_index, block.rate, values // channels)


def truth_shape(data: bytes) -> BlockShape:
    """Return which scans an atpid_interfaces/msg/PlantTruth holds; raise MessageError for an invalid one."""
    truth = _decoded(TRUTH, data)
    return BlockShape(truth.first_index, truth.rate, len(truth.support))


def event(data: bytes) -> Sent:
    """Return kind and node of an atpid_interfaces/msg/Event; raise MessageError for an invalid one."""
    decoded = _decoded(EVENT, data)
    return Sent(str(decoded.kind), str(decoded.node))


def _decoded(kind: str, data: bytes) -> Any:
    try:
        return decoder_of(kind).decode(0, data)
    except BagError:
        raise MessageError("its bytes do not fit its type") from None


@cache
def decoder_of(kind: str) -> Decoder:
    """Return what decodes messages of the installed type `kind`, as schema 0; raise TypeUnknownError."""
    decoder = Decoder()
    decoder.add(Schema(id=0, name=kind, encoding="ros2msg", data=message_type(kind).definition.encode()))
    return decoder
