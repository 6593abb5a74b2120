# SPDX-License-Identifier: Apache-2.0
"""The ceiling's motor: one protocol (`CeilingActuator`), two backends (a simulated ceiling, a serial port)."""

from atpid_driver.motor.ceiling_actuator import CeilingActuator, Identity, Limits, Mode, Reading
from atpid_driver.motor.errors import (
    CommandStaleError,
    HeightRefusedError,
    IdentityError,
    LimitsError,
    LinkError,
    MotorError,
    NotReadyError,
    ProtocolError,
    SettingsError,
)
from atpid_driver.motor.faults import Fault, in_words
from atpid_driver.motor.registry import BACKENDS, actuator_of
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.motor.simulated import SimulatedActuator

__all__ = [
    "BACKENDS",
    "CeilingActuator",
    "CommandStaleError",
    "Fault",
    "HeightRefusedError",
    "Identity",
    "IdentityError",
    "Limits",
    "LimitsError",
    "LinkError",
    "Mode",
    "MotorError",
    "MotorSettings",
    "NotReadyError",
    "ProtocolError",
    "Reading",
    "SettingsError",
    "SimulatedActuator",
    "actuator_of",
    "in_words",
]
