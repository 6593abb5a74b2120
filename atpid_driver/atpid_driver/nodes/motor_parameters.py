# SPDX-License-Identifier: Apache-2.0
"""Parameters of the motor node: declared with description and range, read into `MotorSettings`."""

from __future__ import annotations

from math import nan

from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.parameters import Row, declare
from atpid_driver.motor.registry import BACKENDS
from atpid_driver.motor.settings import MotorSettings

TYPES = Parameter.Type
INITIAL_HEIGHT = (
    "where a real ceiling goes after homing, NaN: it stays; where a simulated one stands, NaN: where that of the "
    "simulated plant stands"
)
TABLE = (
    Row("backend", TYPES.STRING, "what moves the ceiling", choices=BACKENDS),
    Row("lowest", TYPES.DOUBLE, "lowest ceiling height, the grain's diameter", "m", 0.0, 10.0),
    Row("highest", TYPES.DOUBLE, "highest ceiling height", "m", 0.0, 10.0),
    Row("speed", TYPES.DOUBLE, "constant travelling speed", "m/s", 0.0, 100.0),
    Row("initial_height", nan, INITIAL_HEIGHT, "m"),
    Row("lockstep", False, "answer each command with one state by its stamp instead of publishing on an own period"),
    Row("autostart", True, "configure and activate without a lifecycle manager"),
    Row("rate", 50.0, "states published per second, and heartbeat rate; not used in lockstep", "Hz", 10.0, 200.0),
    Row("command_timeout", 0.5, "a command that waited longer is ignored; not used in lockstep", "s", 0.01, 10.0),
    Row(
        "stale_timeout", 0.4, "silence of ceiling/command after which the ceiling is stopped; not used in lockstep",
        "s", 0.1, 60.0,
    ),
    Row("port", "", "serial port of the board by its stable name, /dev/serial/by-id/..."),
    Row("baud", 250_000, "baud rate of the serial port"),
    Row(
        "identify_timeout", 5.0, "how long to request the board's identity; a reset by opening takes about 2 s",
        "s", 0.1, 60.0,
    ),
)  # fmt: skip


def settings_of(node: Node) -> MotorSettings:
    """Declare the table on `node`, return its values. Raises `ParameterError` or `SettingsError`."""
    return MotorSettings(**declare(node, TABLE))
