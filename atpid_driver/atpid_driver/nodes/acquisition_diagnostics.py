# SPDX-License-Identifier: Apache-2.0
"""The status of an acquisition device in `/diagnostics`."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_driver.acquisition import Identity
from atpid_driver.acquisition.reader import Status
from atpid_driver.calibration.convert import Counts


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
    last_error = last_error or status.last_error
    level, message = DiagnosticStatus.OK, f"streaming at {status.rate:g} Hz" if status.streaming else state
    if last_error:
        level, message = DiagnosticStatus.ERROR, last_error
    elif lost_lately:
        level, message = DiagnosticStatus.WARN, f"{lost_lately} scans lost in the last second"
    values: dict[str, object] = {
        "state": state,
        "rate [Hz]": f"{status.rate:.6f}",
        "next index": status.next_index,
        "backlog [scans]": status.backlog,
        "queued [blocks]": status.queued,
        "dropped [scans]": status.dropped,
        "interruptions": status.interruptions,
        "clock drift [ppm]": f"{status.drift_ppm:.2f}",
        "clock offset [s]": f"{status.offset_s:.6f}",
        "last error": last_error or "none",
    }
    for channel, count in counts.items():
        values[f"{channel} broken loop [samples]"] = count.broken_loop
        values[f"{channel} out of range [samples]"] = count.out_of_range
        values[f"{channel} missing [samples]"] = count.missing
    hardware_id = str(identity.serial) if identity else "none"
    return diagnostic_status(node, "acquisition", level, message, values, hardware_id)
