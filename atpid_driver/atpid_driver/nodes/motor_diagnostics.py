# SPDX-License-Identifier: Apache-2.0
"""The motor's statuses in `/diagnostics`."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.latency import Latencies
from atpid_common.nodes.diagnostics import status
from atpid_driver.motor import CeilingActuator, Mode, Reading, in_words

_LEVELS = {
    Mode.UNCONFIGURED: DiagnosticStatus.ERROR,
    Mode.FAULT: DiagnosticStatus.ERROR,
    Mode.DISARMED: DiagnosticStatus.WARN,
}


def status_of(
    node: Node, actuator: CeilingActuator, reading: Reading, last_error: str, latencies: Latencies
) -> DiagnosticStatus:
    """Return level, one line and the figures of `reading`; what the backend counts (`health`) is added as it is.

    latencies: from a sample to the receipt of the command that answers it.
    """
    health = actuator.health()
    values = {
        "mode": reading.mode.name.lower(),
        "homed": str(reading.homed).lower(),
        "height [m]": f"{reading.height:.4f}",
        "target [m]": f"{reading.target:.4f}",
        "faults": in_words(reading.faults) or "none",
        "last error": last_error or health.pop("last error", "") or "none",
    }
    hardware_id = health.pop("hardware_id", "") or "none"
    values |= latencies.values("sample to command received") | health
    level = _LEVELS.get(reading.mode, DiagnosticStatus.OK)
    message = in_words(reading.faults) or reading.mode.name.lower()
    return status(node, "ceiling motor", level, message, values, hardware_id)
