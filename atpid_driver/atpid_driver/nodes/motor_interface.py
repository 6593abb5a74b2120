# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node as others see it: its parameters, and a reading of the ceiling as message and diagnostic status."""

from dataclasses import MISSING, Field, fields
from typing import Any

from atpid_interfaces.msg import CeilingState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from atpid_common.latency import Latencies
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.parameters import Entry, Value
from atpid_common.vocabulary import Mode
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Reading
from atpid_driver.motor.faults import in_words
from atpid_driver.motor.settings import MotorSettings


def row_of(setting: Field[Any]) -> Entry:
    """Return a field that was made by `described` as a parameter."""
    default = setting.default
    if default is MISSING:
        default = Parameter.Type.STRING if setting.type is str else Parameter.Type.DOUBLE
    return Entry(setting.name, list(default) if isinstance(default, tuple) else default, **setting.metadata)


#: The node's parameters, as `MotorSettings` declares them.
TABLE = tuple(row_of(setting) for setting in fields(MotorSettings) if setting.init)
_LEVELS = {
    Mode.UNCONFIGURED: DiagnosticStatus.ERROR,
    Mode.FAULT: DiagnosticStatus.ERROR,
    Mode.DISARMED: DiagnosticStatus.WARN,
}


def settings_of(value: Value) -> MotorSettings:
    """Return the settings that the parameters have, whose values `value` returns by name. Raises `SettingsError`."""
    return MotorSettings(**{row.name: value(row.name) for row in TABLE})


def state_of(reading: Reading, header: Header, *, handshake: bool) -> CeilingState:
    """Return the message of a reading; `handshake` marks its answer."""
    return CeilingState(
        header=header, handshake=handshake, mode=reading.mode, homed=reading.homed,
        faults=reading.faults, fault=in_words(reading.faults), height=reading.height, target=reading.target,
        velocity=reading.velocity, speed=reading.speed, sequence=reading.sequence,
    )  # fmt: skip


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
