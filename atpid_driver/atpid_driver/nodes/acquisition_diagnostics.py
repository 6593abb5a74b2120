# SPDX-License-Identifier: Apache-2.0
"""The status of an acquisition device in `/diagnostics`."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_driver.acquisition import Identity, Status
from atpid_driver.calibration import Counts


def status_message(
    node: Node,
    identity: Identity | None,
    state: str,
    status: Status,
    counts: dict[str, Counts],
    lost_lately: int,
    last_error: str,
) -> DiagnosticStatus:
    """Return level, one line, and the figures; hardware_id is the device's serial number, "none": not connected."""
    level, message = _judge(status, state, lost_lately, last_error or status.last_error)
    values = {
        "state": state,
        "rate [Hz]": f"{status.rate:.6f}",
        "next index": str(status.next_index),
        "backlog [scans]": str(status.backlog),
        "queued [blocks]": str(status.queued),
        "dropped [scans]": str(status.dropped),
        "interruptions": str(status.interruptions),
        "clock drift [ppm]": f"{status.drift_ppm:.2f}",
        "clock offset [s]": f"{status.offset_s:.6f}",
        "last error": last_error or status.last_error or "none",
    }
    for channel, count in counts.items():
        values[f"{channel} broken loop [samples]"] = str(count.broken_loop)
        values[f"{channel} out of range [samples]"] = str(count.out_of_range)
        values[f"{channel} missing [samples]"] = str(count.missing)
    hardware_id = str(identity.serial) if identity else "none"
    return diagnostic_status(node, "acquisition", level, message, values, hardware_id)


def _judge(status: Status, state: str, lost_lately: int, last_error: str) -> tuple[bytes, str]:
    if last_error:
        return DiagnosticStatus.ERROR, last_error
    if lost_lately:
        return DiagnosticStatus.WARN, f"{lost_lately} scans lost in the last second"
    if not status.streaming:
        return DiagnosticStatus.OK, state
    return DiagnosticStatus.OK, f"streaming at {status.rate:g} Hz"
