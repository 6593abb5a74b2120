# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What can be wrong with the motor: the fault table (bit, name and text), and the errors of commands and of the link.

Bits 0 to 15 are of the firmware; docs/motor_protocol.md has the same table. The message of an error is one line with
what was given, what is allowed and what to do.
"""

from enum import IntFlag
from typing import Final

from atpid_driver import DriverError, SettingsError


class MotorFault(IntFlag):
    """Latched faults; after each of them the motor stays off until a person arms it again."""

    HEARTBEAT = 1 << 0
    STALL = 1 << 1
    SENSOR_LOW = 1 << 2
    SENSOR_HIGH = 1 << 3
    SENSOR_JUMP = 1 << 4
    SENSOR_SILENT = 1 << 5
    WRONG_WAY = 1 << 6
    UNCOMMANDED = 1 << 7
    LOWER_LIMIT = 1 << 8
    UPPER_LIMIT = 1 << 9
    BOTH_LIMITS = 1 << 10
    EMERGENCY_STOP = 1 << 11
    HOMING = 1 << 12
    OVERTIME = 1 << 13
    SOFT_LIMIT = 1 << 14
    WATCHDOG = 1 << 15
    LINK_LOST = 1 << 16
    RESTARTED = 1 << 17


NO_FAULT: Final = MotorFault(0)
#: Without a heartbeat for so long a motor that is armed is switched off [ns].
HEARTBEAT_TIME: Final = 500_000_000

WORDS: Final[dict[MotorFault, str]] = {
    MotorFault.HEARTBEAT: "no heartbeat from the host for 500 ms",
    MotorFault.STALL: "motor on but the ceiling does not move (jammed, or no motor power)",
    MotorFault.SENSOR_LOW: "position sensor open or shorted to ground",
    MotorFault.SENSOR_HIGH: "position sensor shorted to supply",
    MotorFault.SENSOR_JUMP: "position sensor jumped further than the ceiling can move",
    MotorFault.SENSOR_SILENT: "position sensor is not being converted",
    MotorFault.WRONG_WAY: "ceiling moves against its command (motor leads swapped?)",
    MotorFault.UNCOMMANDED: "ceiling moves with the motor off",
    MotorFault.LOWER_LIMIT: "lower limit switch open where it must be closed (end reached, stuck, or broken wire)",
    MotorFault.UPPER_LIMIT: "upper limit switch open where it must be closed (end reached, stuck, or broken wire)",
    MotorFault.BOTH_LIMITS: "both limit switches open (connector or cable)",
    MotorFault.EMERGENCY_STOP: "emergency stop pressed",
    MotorFault.HOMING: "homing did not find the upper limit switch where it must be",
    MotorFault.OVERTIME: "a move took longer than its distance allows",
    MotorFault.SOFT_LIMIT: "ceiling outside its soft limits",
    MotorFault.WATCHDOG: "the firmware was restarted by its watchdog",
    MotorFault.LINK_LOST: "the connection to the board was lost while the motor was armed",
    MotorFault.RESTARTED: "the board was restarted while the motor was armed",
}


def in_words(faults: MotorFault) -> str:
    """Return the faults in words, separated by "; "; empty for none."""
    return "; ".join(WORDS[bit] for bit in MotorFault if bit in faults)


class LimitsError(SettingsError):
    """The limits asked for are not possible, or not inside those built into the firmware."""


class HeightRefusedError(DriverError):
    """A height outside the limits; the ceiling stays on its present target."""


class CommandStaleError(DriverError):
    """A command that waited longer than the time-out between receipt and execution."""


class LinkError(DriverError):
    """The port is missing, taken, silent or was pulled out."""


class StopNotConfirmedError(LinkError):
    """A stop that the board has not confirmed in time; it goes on being sent."""


class IdentityError(LinkError):
    """The board at the port does not run the firmware of this driver."""


class ProtocolError(DriverError):
    """A frame that breaks the protocol: wrong check sum, form or field."""
