# SPDX-License-Identifier: Apache-2.0
"""Backends by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from atpid_driver.motor.ceiling_actuator import CeilingActuator
from atpid_driver.motor.errors import SettingsError
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.motor.simulated import SimulatedActuator


def _simulated(settings: MotorSettings) -> CeilingActuator:
    return SimulatedActuator(settings.limits, settings.initial_height)


def _serial(settings: MotorSettings) -> CeilingActuator:
    # Imported here so that a simulated bench does not need pyserial.
    from atpid_driver.motor.serial_actuator import SerialActuator

    return SerialActuator(settings)


BACKENDS: Final[dict[str, Callable[[MotorSettings], CeilingActuator]]] = {"simulated": _simulated, "serial": _serial}


def actuator_of(settings: MotorSettings) -> CeilingActuator:
    """Return the backend named in `settings`; raises `SettingsError` for an unknown name."""
    try:
        make = BACKENDS[settings.backend]
    except KeyError:
        raise SettingsError(f"backend {settings.backend!r}: allowed {', '.join(BACKENDS)}") from None
    return make(settings)
