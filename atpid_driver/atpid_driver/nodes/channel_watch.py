# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The sensors of an acquisition node: each channel's state as event and status, and NaN where one does not measure."""

from collections.abc import Sequence

import numpy as np
from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.channel_monitor import ChannelState
from atpid_common.files import Document
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.parameters import Publish
from atpid_common.parameters import Entry
from atpid_driver.calibration.channel_state import Thresholds, VoltageMonitor
from atpid_driver.calibration.model import Calibration, Counts, Floats

THRESHOLDS = (
    Entry("dead_time", 0.2, "a channel without one usable reading for so long is faulty", "s", 0.01, 60.0),
    Entry("frozen_time", 1.0, "time over which frozen and clipped readings and spikes are looked for", "s", 0.1, 600.0),
    Entry("clipped_share", 0.02, "share of unusable readings from which a channel is clipped", "-", 0.0001, 1.0),
    Entry("spike", 0.0, "a reading further than this from both its neighbours is a spike; 0: none is", "V", 0.0, 100.0),
    Entry("spikes_per_second", 3.0, "from which spikes are reported", "1/s", 0.01, 100_000.0),
)
_EVENTS = ((Event.INFO, Event.RECOVERED), (Event.WARNING, Event.FAULT), (Event.ALARM, Event.FAULT))
_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class ChannelWatch:
    """One monitor for each channel; a channel whose sensor does not measure is NaN in what is published."""

    def __init__(self, node: Node, calibrations: Sequence[Calibration], values: Document, publish: Publish) -> None:
        """Begin. values: the node's parameters by name; publish: publishes an event."""
        self._node, self._calibrations, self._publish = node, calibrations, publish
        noise = float(values.get("converter_noise", 0.0))  # of a backend that has none: only equal readings are frozen
        self._thresholds = Thresholds(
            converter_noise=noise, **{row.name: float(values[row.name]) for row in THRESHOLDS}
        )
        self.begin()

    def begin(self) -> None:
        """Forget what was seen: a stream begins."""
        self._monitors = [VoltageMonitor(calibration, self._thresholds) for calibration in self._calibrations]
        self._counts = [Counts() for _ in self._calibrations]

    def take(self, volts: Floats, values: Floats, counts: Sequence[Counts], rate: float) -> bool:
        """Judge a block (n_scans, n_channels) [V]; return whether a state has changed.

        Sets the `values` (same shape, SI) of channels whose sensor does not measure to NaN.
        """
        before = [monitor.finding.state for monitor in self._monitors]
        for column, monitor in enumerate(self._monitors):
            self._counts[column] += counts[column]
            changed = monitor.take(volts[:, column], values[:, column], counts[column], rate)
            if monitor.finding.state.severity == 2:
                values[:, column] = np.nan
            if changed is not None:
                again = " again" if changed.state is ChannelState.PLAUSIBLE else ""
                text = f"{self._calibrations[column].channel}: {changed.text}{again}"
                self._publish(*_EVENTS[changed.state.severity], text, monitor.last_volts)
        return before != [monitor.finding.state for monitor in self._monitors]

    def statuses(self, hardware_id: str) -> list[DiagnosticStatus]:
        """Return one status for each channel."""
        found = []
        for calibration, monitor, count in zip(self._calibrations, self._monitors, self._counts, strict=True):
            values = {
                "state": monitor.finding.state.value,
                "reading [V]": f"{monitor.last_volts:.4f}",
                "spread [V]": f"{monitor.spread:.6f}",
                "broken loop [samples]": count.broken_loop,
                "out of range [samples]": count.out_of_range,
                "missing [samples]": count.missing,
            }
            level = _LEVELS[monitor.finding.state.severity]
            found.append(status(self._node, calibration.channel, level, monitor.finding.text, values, hardware_id))
        return found
