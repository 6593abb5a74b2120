# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of standard types, serialised without their packages: viewers have the definitions in the file."""

import struct
from functools import cache
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_typestore

NUMBER, TEXT = "std_msgs/msg/Float64", "std_msgs/msg/String"
LOG, MARKERS = "rcl_interfaces/msg/Log", "visualization_msgs/msg/MarkerArray"
#: All topics made here begin with it.
PREFIX = "/traces/"
_NUMBER = struct.Struct("<4xd")  # XCDR1, little-endian: 4 bytes of encapsulation, a double
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"


class TraceRecord(NamedTuple):
    """One serialised message."""

    topic: str
    type: str
    time_ns: int
    data: bytes


def number(name: str, time_ns: int, value: float) -> TraceRecord:
    """Return a std_msgs/Float64 on the topic PREFIX + `name`."""
    return TraceRecord(PREFIX + name, NUMBER, time_ns, _LITTLE_ENDIAN + _NUMBER.pack(value)[4:])


def message(name: str, time_ns: int, kind: str, content: Any) -> TraceRecord:
    """Return `content`, made by `class_of(kind)`, on the topic PREFIX + `name`."""
    return TraceRecord(PREFIX + name, kind, time_ns, bytes(_store().serialize_cdr(content, kind)))


def class_of(kind: str) -> Any:
    """Return the class of a standard message type, "pkg/msg/Name"."""
    return _store().types[kind]


@cache
def definition(kind: str) -> bytes:
    """Return the definition of a standard message type and, after separators, those of all types inside it."""
    return str(_store().generate_msgdef(kind, ros_version=2)[0]).encode()


@cache
def _store() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)
