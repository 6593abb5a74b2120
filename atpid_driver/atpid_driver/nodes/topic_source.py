# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Subscribes for the backend `topic` to another driver's messages, of any type, and takes the channels' numbers out."""

import re
from collections.abc import Callable, Mapping
from functools import reduce
from importlib import import_module
from operator import attrgetter
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from atpid_common.nodes.messages import STEADY, nanoseconds_of
from atpid_driver.acquisition import SetupRefusedError
from atpid_driver.acquisition.protocol import Volts
from atpid_driver.acquisition.topic import TopicAcquisition

_TERMINAL = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\[(\d+)\])?")
_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_AVAILABLE)
#: What takes a field out of a message, and the number's place in it, where it is an array.
_Field = tuple[Callable[[object], Any], int | None]
_LOOK = 0.1  # how often a publisher is looked for [s]


def subscribe_source(node: Node, device: TopicAcquisition) -> None:
    """Subscribe to the device's topic. Raises SetupRefusedError: its type is not installed, or has no such field."""
    settings = device.settings
    package, _, name = settings.source_type.partition("/msg/")
    try:
        kind = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):
        raise SetupRefusedError(
            f"source_type: given {settings.source_type!r}, which is not in this shell; allowed: pkg/msg/Type, installed"
        ) from None
    example = kind()
    take = [_number(example, channel.terminal, settings.source_type) for channel in settings.channels]
    stamp_of = attrgetter("header.stamp") if hasattr(example, "header") else None

    def on_message(message: object, info: Mapping[str, object]) -> None:
        try:
            values = np.atleast_2d(_scans(message, take, settings.columns))
        except (IndexError, ValueError, TypeError) as error:
            node.get_logger().error(f"{settings.source}: a message has other numbers: {error}", once=True)
            return
        stamp = nanoseconds_of(stamp_of(message)) if stamp_of else 0
        number = info.get("publication_sequence_number")
        device.arrived(values, stamp or None, number if isinstance(number, int) and 0 < number < 2**62 else None)

    def subscribe() -> None:  # what is best available is found among the publishers that are there
        if node.count_publishers(settings.source):
            looking.cancel()
            node.create_subscription(kind, settings.source, on_message, _QOS)

    looking = node.create_timer(_LOOK, subscribe, clock=STEADY)


def _scans(message: object, take: list[_Field], columns: int) -> Volts:
    """Return the scans (k, channels) in a message."""
    if not columns:
        return np.array([float(get(message) if at is None else get(message)[at]) for get, at in take])
    return np.column_stack([np.reshape(get(message), (-1, columns))[:, at or 0] for get, at in take]).astype(float)


def _number(example: Any, terminal: str, kind: str) -> _Field:
    """Return what takes a channel's field out of a message, and its place in an array. Raises SetupRefusedError."""
    found = _TERMINAL.fullmatch(terminal)
    try:
        if found is None:
            raise AttributeError(terminal)
        reduce(getattr, found[1].split("."), example)
    except AttributeError:
        fields = ", ".join(example.get_fields_and_field_types())
        raise SetupRefusedError(
            f"terminals: given {terminal!r}, which {kind} does not have; allowed: a number in it, such as data[0] or "
            f"linear_acceleration.z, of its fields {fields}"
        ) from None
    return attrgetter(found[1]), None if found[2] is None else int(found[2])
