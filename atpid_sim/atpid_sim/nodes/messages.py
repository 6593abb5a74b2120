# SPDX-License-Identifier: Apache-2.0
"""From the stream's blocks to messages, and the queues they travel in."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from atpid_interfaces.msg import Event, PlantTruth, SampleBlock
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from atpid_sim.stream import Reading, StreamBlock, stamp_ns

HELLO = "hello"

BLOCKS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
EVENTS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATUS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def time_of(nanoseconds: int) -> Time:
    """Return `nanoseconds` [ns] as a ROS time."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def nanoseconds_of(stamp: Time) -> int:
    """Return a ROS time in [ns]."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def doubles(values: NDArray[np.float64]) -> array.array[float]:
    """Return `values` as a message's float64[]: about 2 us, where assigning the numpy array costs a millisecond."""
    filled = array.array("d")
    filled.frombytes(memoryview(np.ascontiguousarray(values)).cast("B"))
    return filled


def sample_block(reading: Reading, start_ns: int, frame_id: str) -> SampleBlock:
    """Return one device's readings as its message."""
    message = SampleBlock()
    message.header.stamp = time_of(stamp_ns(start_ns, reading.first_index, reading.rate))
    message.header.frame_id = frame_id
    message.first_index = reading.first_index
    message.rate = reading.rate
    message.channels = list(reading.instrument.channels)
    message.units = list(reading.instrument.units)
    message.skew = doubles(np.zeros(len(reading.instrument.channels)))
    message.data = doubles(reading.data)
    return message


def truth_message(block: StreamBlock, start_ns: int, frame_id: str) -> PlantTruth:
    """Return what the plant knows about one block."""
    laser, truth = block.readings[0], block.truth
    message = PlantTruth()
    message.header.stamp = time_of(stamp_ns(start_ns, block.first_index, laser.rate))
    message.header.frame_id = frame_id
    message.first_index = block.first_index
    message.rate = laser.rate
    for name in ("excitation_amplitude", "excitation_frequency", "input_energy", "beam_loss", "contact_loss",
                 "ceiling_work", "stored_energy"):  # fmt: skip
        setattr(message, name, float(getattr(truth, name)))
    message.impacts = int(truth.impacts)
    for name in ("support", "beam", "grain", "ceiling"):
        setattr(message, name, doubles(block.truth_series(name)))
    return message


def hello(kind: type[Any], channels: tuple[str, ...] = (), units: tuple[str, ...] = ()) -> Any:
    """Return the handshake of one topic: no data, stamp 0, frame_id "hello"."""
    message = kind()
    message.header.frame_id = HELLO
    if kind is SampleBlock:
        message.channels, message.units = list(channels), list(units)
    if kind is Event:
        message.kind = HELLO
    return message
