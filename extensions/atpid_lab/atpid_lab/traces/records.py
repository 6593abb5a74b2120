# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of standard types, serialised without their packages: viewers have the definitions in the file."""

import math
import struct
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from atpid_common.vocabulary import Frame

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


def message(name: str, time_ns: int, kind: str, content: object) -> TraceRecord:
    """Return `content`, made by `class_of(kind)`, on the topic PREFIX + `name`."""
    return TraceRecord(PREFIX + name, kind, time_ns, bytes(_store().serialize_cdr(content, kind)))


def class_of(kind: str) -> Callable[..., object]:
    """Return the class of a standard message type, "pkg/msg/Name"."""
    return _store().types[kind]


@cache
def definition(kind: str) -> bytes:
    """Return the definition of a standard message type and, after separators, those of all types inside it."""
    return str(_store().generate_msgdef(kind, ros_version=2)[0]).encode()


@cache
def _store() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


#: Width and thickness of the plates drawn, and the distance of the support below the floor [m]; not those of a stand.
_WIDTH, _THICK, _BELOW = 0.06, 0.004, 0.1
_CUBE, _SPHERE = 1, 2
_NO_BYTES = np.zeros(0, np.uint8)
_GREY, _BLUE, _ORANGE, _RED = (0.5, 0.5, 0.5), (0.12, 0.47, 0.71), (1.0, 0.5, 0.05), (0.84, 0.15, 0.16)


class Pose(NamedTuple):
    """Where the parts of the damper are at one instant [m]; NaN: not known, and not drawn."""

    support: float
    beam: float
    grain: float = math.nan
    height: float = math.nan


def damper(time_ns: int, pose: Pose, radius: float) -> TraceRecord:
    """Return the markers of the damper; `radius` of the grain [m]."""
    plates = (
        (1, "support", pose.support - _BELOW, _GREY),
        (2, "floor", pose.beam, _BLUE),
        (3, "ceiling", pose.beam + pose.height + _THICK, _ORANGE),
    )
    drawn = [
        _marker(time_ns, number, name, _CUBE, z - 0.5 * _THICK, (_WIDTH, _WIDTH, _THICK), colour)
        for number, name, z, colour in plates
        if math.isfinite(z)
    ]
    if math.isfinite(pose.grain):  # 0 where it just touches the floor at rest
        size = (2.0 * radius,) * 3
        drawn.append(_marker(time_ns, 4, "grain", _SPHERE, pose.grain + radius, size, _RED))
    return message("damper", time_ns, MARKERS, class_of(MARKERS)(markers=drawn))


def _marker(
    time_ns: int, number: int, name: str, shape: int, z: float, size: tuple[float, ...], colour: tuple[float, ...]
) -> object:
    time, header = class_of("builtin_interfaces/msg/Time"), class_of("std_msgs/msg/Header")
    point, turn = class_of("geometry_msgs/msg/Point"), class_of("geometry_msgs/msg/Quaternion")
    rgba, image = class_of("std_msgs/msg/ColorRGBA"), class_of("sensor_msgs/msg/CompressedImage")
    stamp, nothing = time(*divmod(time_ns, 1_000_000_000)), header(time(0, 0), "")
    return class_of("visualization_msgs/msg/Marker")(
        header=header(stamp, Frame.STAND), ns=name, id=number, type=shape, action=0,
        pose=class_of("geometry_msgs/msg/Pose")(point(0.0, 0.0, z), turn(0.0, 0.0, 0.0, 1.0)),
        scale=class_of("geometry_msgs/msg/Vector3")(*size), color=rgba(*colour, 1.0),
        lifetime=class_of("builtin_interfaces/msg/Duration")(0, 0), frame_locked=False, points=[], colors=[],
        texture_resource="", texture=image(nothing, "", _NO_BYTES), uv_coordinates=[], text="",
        mesh_resource="", mesh_file=class_of("visualization_msgs/msg/MeshFile")("", _NO_BYTES),
        mesh_use_embedded_materials=False,
    )  # fmt: skip
