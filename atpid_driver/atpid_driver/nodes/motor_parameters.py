# SPDX-License-Identifier: Apache-2.0
"""Parameters of the motor node: declared with description and range, read into `MotorSettings`."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_driver.motor import MotorSettings, SettingsError

# Name: (description, lowest, highest); a range only where the type is a double.
_DESCRIPTIONS: Final[dict[str, tuple[str, float | None, float | None]]] = {
    "backend": ("what moves the ceiling: simulated or serial", None, None),
    "lowest": ("lowest ceiling height, the grain's diameter [m]", 0.0, 10.0),
    "highest": ("highest ceiling height [m]", 0.0, 10.0),
    "speed": ("constant travelling speed [m/s]", 0.0, 100.0),
    "initial_height": (
        "where a real ceiling goes after homing, NaN: it stays; where a simulated one stands, NaN: where that of the "
        "simulated plant stands [m]",
        None,
        None,
    ),
    "lockstep": ("answer each command with one state by its stamp instead of publishing on an own period", None, None),
    "autostart": ("configure and activate without a lifecycle manager", None, None),
    "rate": ("states published per second, and heartbeat of the motor [Hz]; not used in lockstep", 10.0, 200.0),
    "command_timeout": ("a command that waited longer is ignored [s]; not used in lockstep", 0.01, 10.0),
    "stale_timeout": (
        "silence of ceiling/command after which the ceiling is stopped [s]; not used in lockstep",
        0.1,
        60.0,
    ),
    "port": ("serial port of the board by its stable name, /dev/serial/by-id/...", None, None),
    "baud": ("baud rate of the serial port", None, None),
    "identify_timeout": (
        "how long to ask the board for its identity [s]; a reset by opening takes about 2 s",
        0.1,
        60.0,
    ),
}
_TYPES: Final = {
    "str": Parameter.Type.STRING,
    "float": Parameter.Type.DOUBLE,
    "bool": Parameter.Type.BOOL,
    "int": Parameter.Type.INTEGER,
}


def declare(node: Node) -> MotorSettings:
    """Declare all parameters on `node`, return their values. Raises `SettingsError` for one missing or impossible."""
    values: dict[str, Any] = {}
    for setting in fields(MotorSettings):
        if not setting.init:
            continue
        kind = _TYPES[str(setting.type)]
        default = kind if setting.default is MISSING else setting.default
        try:
            values[setting.name] = node.declare_parameter(setting.name, default, _descriptor(setting.name)).value
        except Exception as error:  # rclpy has one exception per kind of bad value; each text names the parameter
            raise SettingsError(f"parameter {setting.name} of {node.get_name()}: {error}") from error
        if values[setting.name] is None:
            raise SettingsError(
                f"parameter {setting.name} of {node.get_name()} is not given and has no default: "
                f"{_DESCRIPTIONS[setting.name][0]}; set it in the parameter file"
            )
    return MotorSettings(**values)


def _descriptor(name: str) -> ParameterDescriptor:
    text, lowest, highest = _DESCRIPTIONS[name]
    descriptor = ParameterDescriptor(name=name, description=text, read_only=True)
    if lowest is not None and highest is not None:
        descriptor.floating_point_range = [FloatingPointRange(from_value=lowest, to_value=highest, step=0.0)]
    return descriptor
