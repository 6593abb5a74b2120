# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ceiling's motor: one protocol (`CeilingActuator`), two backends by name (a simulated ceiling, a serial port)."""

from atpid_driver.motor.ceiling_actuator import CeilingActuator
from atpid_driver.motor.settings import BACKENDS, MotorSettings
from atpid_driver.motor.simulated import FaultyActuator, SimulatedActuator

__all__ = ["BACKENDS", "CeilingActuator", "MotorSettings", "actuator_of"]


def actuator_of(settings: MotorSettings) -> CeilingActuator:
    """Return the backend named in `settings`."""
    if settings.backend == "simulated" and settings.injected:
        return FaultyActuator(settings.limits, settings.initial_height, ())
    if settings.backend == "simulated":
        return SimulatedActuator(settings.limits, settings.initial_height)
    from atpid_driver.motor.serial_actuator import SerialActuator  # here: a simulated bench does not need pyserial

    return SerialActuator(settings)
