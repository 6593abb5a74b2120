# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Conversions between messages and numbers, the quality of service of the topics, and the clock of all timers."""

from __future__ import annotations

import array

import numpy as np
from atpid_interfaces.msg import SampleBlock
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

#: What is timed by it does not depend on the time that is set.
STEADY = Clock(clock_type=ClockType.STEADY_TIME)
BLOCKS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
EVENTS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
#: What a publisher of events offers: kept for a recorder that is discovered later. A volatile subscription fits, too.
EVENTS_KEPT = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STATES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATUS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def time_of(nanoseconds: int) -> Time:
    """Return `nanoseconds` since the epoch [ns] as a ROS time."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def nanoseconds_of(stamp: Time) -> int:
    """Return a ROS time in nanoseconds since the epoch [ns]."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def scans_of(block: SampleBlock) -> int:
    """Return how many scans a block has."""
    return len(block.data) // max(len(block.channels), 1)


def channels_of(block: SampleBlock) -> dict[str, NDArray[np.float64]]:
    """Return the samples (n_scans,) of a block by the names of its channels."""
    columns = np.frombuffer(block.data, dtype=np.float64).reshape(-1, max(len(block.channels), 1)).T
    return dict(zip(block.channels, columns, strict=False))


def doubles(values: NDArray[np.float64]) -> array.array[float]:
    """Return `values`, row-major, as a message's float64[]: 2 us for a block, where a numpy array takes 1 ms."""
    filled = array.array("d")
    filled.frombytes(memoryview(np.ascontiguousarray(values)).cast("B"))
    return filled
