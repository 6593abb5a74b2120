# SPDX-License-Identifier: Apache-2.0
"""The motor node as others see it: its parameters, and a reading of the ceiling as message and diagnostic status."""

from dataclasses import asdict
from math import nan

from atpid_interfaces.msg import CeilingState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from atpid_common.latency import Latencies
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.parameters import Row, Value
from atpid_driver.motor import BACKENDS
from atpid_driver.motor.ceiling_actuator import CeilingActuator, Mode, Reading
from atpid_driver.motor.faults import in_words
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
    Row("commander", "", "name of the only node whose commands are followed; empty: of any, one at a time"),
    Row(
        "faults", [""], "faults to act, of a simulated ceiling or of the serial link: 'PART KIND FROM TO [VALUE]' "
        "(docs/faults.md); empty: none", live=True,
    ),
    Row("supervised", False, "move, and send heartbeats, only while the supervisor permits it; not used in lockstep"),
    Row("supervision_timeout", 0.3, "silence of the supervisor that withdraws its permission", "s", 0.1, 10.0),
    Row(
        "check_move", 0.0, "before a run the ceiling moves by this distance and back: direction, distance and speed "
        "are checked; 0: none", "m", 0.0, 10.0,
    ),
    Row("port", "", "serial port of the board by its stable name, /dev/serial/by-id/..."),
    Row("baud", 250_000, "baud rate of the serial port"),
    Row(
        "identify_timeout", 5.0, "how long to request the board's identity; a reset by opening takes about 2 s",
        "s", 0.1, 60.0,
    ),
)  # fmt: skip
_LEVELS = {
    Mode.UNCONFIGURED: DiagnosticStatus.ERROR,
    Mode.FAULT: DiagnosticStatus.ERROR,
    Mode.DISARMED: DiagnosticStatus.WARN,
}


def settings_of(value: Value) -> MotorSettings:
    """Return the settings that the parameters have, whose values `value` returns by name. Raises `SettingsError`."""
    return MotorSettings(**{row.name: value(row.name) for row in TABLE})


def state_of(reading: Reading, header: Header, *, handshake: bool) -> CeilingState:
    """Return the message of a reading, whose fields it has but for `time`; `handshake` marks its answer."""
    fields = asdict(reading)
    del fields["time"]
    return CeilingState(header=header, handshake=handshake, fault=in_words(reading.faults), **fields)


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
