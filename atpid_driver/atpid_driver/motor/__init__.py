# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ceiling's motor: one protocol (`CeilingActuator`), backends by name: simulated, a serial port, or a package's."""

from atpid_common.entry_points import installed, loaded
from atpid_driver import SettingsError
from atpid_driver.motor.ceiling_actuator import CeilingActuator
from atpid_driver.motor.settings import BACKENDS, BUILT_IN, DRIVES, MotorSettings
from atpid_driver.motor.simulated import FaultyActuator, SimulatedActuator

__all__ = ["BACKENDS", "CeilingActuator", "MotorSettings", "actuator_of"]


def actuator_of(settings: MotorSettings) -> CeilingActuator:
    """Return the backend named in `settings`, which nothing has opened.

    Raises SettingsError where a package's drive cannot be loaded, or is none.
    """
    if settings.backend == "simulated" and settings.injected:
        return FaultyActuator(settings.limits, settings.initial_height, ())
    if settings.backend == "simulated":
        return SimulatedActuator(settings.limits, settings.initial_height)
    if settings.backend == "serial":
        from atpid_driver.motor.serial_actuator import SerialActuator  # here: a simulated bench does not need pyserial

        return SerialActuator(settings)
    point = installed(DRIVES, BUILT_IN, SettingsError)[settings.backend]
    drive = loaded(point, error=SettingsError)(settings)
    if not isinstance(drive, CeilingActuator):
        missing = sorted(name for name in vars(CeilingActuator) if name[0] != "_" and not hasattr(drive, name))
        raise SettingsError(
            f"backend {settings.backend} ({point.value}): lacks {', '.join(missing)} of CeilingActuator"
        )
    return drive
