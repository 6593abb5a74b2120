# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag of two devices that measure one signal, each by a clock of its own, over a transport that delays."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from recorded import make

from atpid_control.recording.session import RecordingSession
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.topics import DEFAULT, parse
from atpid_driver.clock import DeviceClock, time_base_ns
from atpid_sim.system import Array


@dataclass(frozen=True)
class Device:
    """One device: its topic, its channels with units and skews [s], the rate it states [Hz], drift [-], delay [s]."""

    topic: str
    channels: tuple[tuple[str, str, float], ...]
    rate: float
    slow: float
    delay: float
    start: float = 0.0  # of its stream, after the begin [s]


def recorded(
    folder: Path, scene: Path, seconds: float, devices: tuple[Device, ...], value: Callable[[str, Array], Array],
    seed: int = 0,
) -> Path:  # fmt: skip
    """Record what `devices` read of the channels' values at times (n,) [s] into `folder`, in blocks of 50 ms."""
    random = np.random.default_rng(seed)
    topics = [type(topic)(f"/{topic.name}", topic.type) for topic in parse(DEFAULT, False)]
    session = RecordingSession(folder, new_run(scene), topics, lockstep=False, offered=lambda _topic: (Qos(),))
    blocks = []
    for device in devices:
        clock, scans = DeviceClock(), round(0.05 * device.rate)
        for number in range(int((seconds - device.start) / 0.05)):
            index = number * scans + np.arange(scans)
            true = device.start + index / device.rate * (1.0 + device.slow)
            end = (index[-1] + 1) / device.rate
            arrival = device.start + end * (1.0 + device.slow) + random.exponential(device.delay)
            clock.add(end, 5000.0 + arrival)
            data = np.column_stack([value(name, true + skew) for name, _, skew in device.channels])
            message = make(
                "SampleBlock", clock.stamp_ns(index[0] / device.rate), device.topic.rpartition("/")[2],
                first_index=int(index[0]), rate=device.rate, data=np.ravel(data),
                channels=[name for name, _, _ in device.channels], units=[unit for _, unit, _ in device.channels],
                skew=np.array([skew for _, _, skew in device.channels]),
            )  # fmt: skip
            blocks.append((arrival, device.topic, message))
    for arrival, topic, message in sorted(blocks, key=lambda one: one[0]):
        session.receive(topic, message, time_base_ns() + round((5000.0 + arrival) * 1e9))
    session.close()
    return folder
