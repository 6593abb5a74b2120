# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The identifier's watch over channels and stamps: events and diagnostics."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from atpid_interfaces.msg import Event, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.channel_monitor import ChannelState
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import nanoseconds_of, time_of
from atpid_control.loop.signal_watch import ClockWatch, SignalSettings, SignalWatch


class SignalFaults:
    """One watch for each channel of the blocks it is given, and one for the stamps of each device."""

    def __init__(self, node: Node, events: EventPublisher, settings: SignalSettings, clock_tolerance: float) -> None:
        """Begin; `clock_tolerance` [s]: how far stamps may move away from the indices."""
        self._node, self._events = node, events
        self._settings, self._clock_tolerance = settings, clock_tolerance
        self._watches: dict[str, SignalWatch] = {}
        self._clocks: dict[str, ClockWatch] = {}

    def configure(self, settings: SignalSettings, clock_tolerance: float) -> None:
        """Judge by other thresholds from the next block on."""
        self._settings, self._clock_tolerance = settings, clock_tolerance
        for clock in self._clocks.values():
            clock.tolerance = clock_tolerance

    def take(self, block: SampleBlock, last_ns: int) -> None:
        """Judge a block whose last scan was taken at `last_ns`; publish what has changed."""
        names = list(block.channels)
        data = np.frombuffer(block.data, dtype=np.float64).reshape(-1, max(len(names), 1))
        for column, (name, unit) in enumerate(zip(names, block.units, strict=False)):
            watch = self._watches.setdefault(name, SignalWatch(self._settings))
            # an impact's acceleration has no limit
            watch.settings = self._settings if unit == "m" else replace(self._settings, largest_velocity=0.0)
            changed = watch.push(block.rate, data[:, column])
            if changed is not None:
                again = " again" if changed.state is ChannelState.PLAUSIBLE else ""
                self._publish(not again, f"{name}: {changed.text}{again}", math.nan, last_ns)
        device = str(block.device)
        clock = self._clocks.setdefault(device, ClockWatch(self._clock_tolerance))
        faulty = clock.push(nanoseconds_of(block.header.stamp) * 1e-9, block.first_index, block.rate)
        if faulty is not None:
            off = f"are {clock.off:+.3f} s off their indices" if faulty else "agree with their indices again"
            self._publish(faulty, f"clock: the stamps of {device} {off}", clock.off, last_ns)

    def _publish(self, faulty: bool, text: str, value: float, stamp_ns: int) -> None:
        severity, kind = (Event.ALARM, Event.FAULT) if faulty else (Event.INFO, Event.RECOVERED)
        self._events.publish(severity, kind, text, value, time_of(stamp_ns))

    def statuses(self) -> list[DiagnosticStatus]:
        """Return one status for each channel and clock."""
        found = []
        for name, watch in self._watches.items():
            level = DiagnosticStatus.ERROR if watch.finding.state.severity else DiagnosticStatus.OK
            values: dict[str, Any] = {"state": watch.finding.state.value}
            found.append(status(self._node, name, level, watch.finding.text, values))
        for device, clock in self._clocks.items():
            level = DiagnosticStatus.ERROR if clock.faulty else DiagnosticStatus.OK
            text = f"stamps {clock.off:+.3f} s off their indices"
            found.append(status(self._node, f"clock of {device}", level, text, {"off [s]": clock.off}))
        return found
