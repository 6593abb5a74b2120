# SPDX-License-Identifier: Apache-2.0
"""A reading of the ceiling as a message and as a diagnostic status."""

from __future__ import annotations

from atpid_interfaces.msg import CeilingState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import Header

from atpid_common.latency import Latencies
from atpid_common.nodes.diagnostics import status
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Mode, Reading
from atpid_driver.motor.faults import in_words

_LEVELS = {
    Mode.UNCONFIGURED: DiagnosticStatus.ERROR,
    Mode.FAULT: DiagnosticStatus.ERROR,
    Mode.DISARMED: DiagnosticStatus.WARN,
}


def state_of(reading: Reading, header: Header, *, handshake: bool) -> CeilingState:
    """Return the message of a reading; `handshake` marks an answer to the handshake."""
    return CeilingState(
        header=header,
        handshake=handshake,
        mode=int(reading.mode),
        homed=reading.homed,
        faults=int(reading.faults),
        fault=in_words(reading.faults),
        height=reading.height,
        target=reading.target,
        velocity=reading.velocity,
        speed=reading.speed,
        sequence=reading.sequence,
    )


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
