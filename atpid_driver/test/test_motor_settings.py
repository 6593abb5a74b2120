# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings, registry and the words of the fault table."""

from typing import Any

import pytest

from atpid_driver import SettingsError
from atpid_driver.motor import actuator_of
from atpid_driver.motor.ceiling_actuator import CeilingActuator
from atpid_driver.motor.errors import HeightRefusedError
from atpid_driver.motor.faults import MotorFault, in_words
from atpid_driver.motor.settings import MotorSettings

GOOD: dict[str, Any] = {
    "backend": "simulated",
    "lowest": 0.017,
    "highest": 1.0,
    "speed": 0.3,
    "initial_height": 0.017,
}


def test_simulated_backend_plays_the_role() -> None:
    assert isinstance(actuator_of(MotorSettings(**GOOD)), CeilingActuator)


def test_serial_backend_plays_the_role_without_opening_anything() -> None:
    settings = MotorSettings(**GOOD | {"backend": "serial", "port": "/dev/no-such-port"})
    assert isinstance(actuator_of(settings), CeilingActuator)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"backend": "hydraulic"}, "allowed simulated, serial"),
        ({"backend": "serial"}, "port is empty"),
        ({"backend": "serial", "port": "/dev/x", "lockstep": True}, "a real motor has its own clock"),
        ({"rate": 0.0}, "rate 0: allowed 10 to 200 Hz"),
        ({"command_timeout": float("nan")}, "command_timeout"),
        ({"lowest": 2.0}, "0 < lowest < highest"),
    ],
)
def test_bad_settings_are_refused_with_the_remedy(change: dict[str, Any], text: str) -> None:
    with pytest.raises(SettingsError, match=text):
        actuator_of(MotorSettings(**GOOD | change))


def test_initial_height_below_the_grain() -> None:
    with pytest.raises(HeightRefusedError):
        MotorSettings(**GOOD | {"initial_height": 0.01})


def test_every_fault_has_words() -> None:
    assert in_words(MotorFault(0)) == ""
    assert len(in_words(~MotorFault(0)).split("; ")) == len(MotorFault) == 18
    assert in_words(MotorFault.STALL | MotorFault.HEARTBEAT).startswith("no heartbeat")
