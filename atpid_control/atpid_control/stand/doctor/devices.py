# SPDX-License-Identifier: Apache-2.0
"""Checks of the stand's devices: board, LabJack, NI module, calibrations. All of them only read; nothing moves."""

import datetime
import grp
import os
import stat
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.stand.doctor.findings import Finding, NotCheckedError, Subject, judged
from atpid_control.supervision.loop_check import Ceiling, disagreements
from atpid_driver.acquisition.registry import create
from atpid_driver.acquisition.settings import wired
from atpid_driver.calibration.convert import calibrations_of, check_channels, si_of
from atpid_driver.calibration.model import Calibration
from atpid_driver.motor.faults import in_words
from atpid_driver.motor.serial_actuator import SerialActuator
from atpid_driver.motor.settings import MotorSettings

#: A calibration is made anew after this many days; readings that one needs; its residual over its range [-].
_OLD, _READINGS, _RESIDUAL = 365, 7, 0.01
#: Units by the end of a channel's name.
_UNITS = {"displacement": "m", "acceleration": "m/s^2", "force": "N"}
_LISTED = ("dev/serial/by-id/*", "dev/ttyACM*", "dev/ttyUSB*")


def board(at: Subject) -> Iterator[Finding]:
    """Check the board's port, who holds it, and the firmware behind it, by the driver's own dialogue.

    Opening the port restarts a real board, whose motor is off then; it is asked for its identity and its state.
    """
    values = at.parameters["motor_node"]
    settings = MotorSettings(**{key: values[key] for key in MotorSettings.__dataclass_fields__ if key in values})
    yield from _ceiling(at, settings)
    port = Path(settings.port)
    if problem := _closed(at, port):
        yield problem
        return
    with closing(SerialActuator(settings)) as actuator:
        identity = actuator.connect(0)  # raises MotorError: silent, another firmware, limits wider than its own
        faults = in_words(actuator.observe(0).faults)
    yield judged(f"{identity.name} {identity.version} answers at {settings.port}")
    if faults:
        yield judged(f"it would not be armed: {faults}", "remove the cause (docs/motor_protocol.md)", fails=True)


def _closed(at: Subject, port: Path) -> Finding | None:
    """Return why a port cannot be opened, or must not: a program that has not locked it would be disturbed."""
    if not port.exists():
        found = [f"/{path.relative_to(at.root)}" for pattern in _LISTED for path in at.files(pattern)]
        return judged(f"{port} is not there; there are: {', '.join(found) or 'no serial ports'}",
                      "plug the board in, or give --port", fails=True)  # fmt: skip
    if not stat.S_ISCHR(port.stat().st_mode):
        return judged(f"{port} is no serial port", "give --port", fails=True)
    if not os.access(port, os.R_OK | os.W_OK, effective_ids=True):
        group = "dialout"  # on other distributions uucp
        with suppress(KeyError):
            group = grp.getgrgid(port.stat().st_gid).gr_name
        return judged(f"{port} may not be opened by this user", f"sudo usermod -aG {group} $USER, then log in again",
                      fails=True)  # fmt: skip
    device, holders = str(port.resolve()), []
    for process in at.files("proc/[0-9]*"):
        with suppress(OSError):  # of another user, or ended
            if any(os.readlink(entry) == device for entry in (process / "fd").iterdir()):
                holders.append(f"{(process / 'comm').read_text().strip()} (process {process.name})")
    return judged(f"{port} is held by {', '.join(holders)}", "end it first", fails=True) if holders else None


def _ceiling(at: Subject, settings: MotorSettings) -> Iterator[Finding]:
    """Compare the scene's ceiling with the motor node's, which has to lie inside the firmware's."""
    with suppress(NotCheckedError):
        if (ceiling := at.scene.ceiling).controlled:
            own = Ceiling(settings.lowest, settings.highest, settings.speed)
            for line in disagreements(Ceiling(*ceiling.range, ceiling.speed), own):
                yield judged(line, "change the scene, or the motor's parameter file and firmware", fails=True)


def labjack(at: Subject) -> Iterator[Finding]:
    """Check LabJack's library, the rights to its USB devices, and the T7 itself, which is opened and closed."""
    yield from _opened(at, "labjack_node")
    if not any(at.files(f"{folder}/udev/rules.d/*abjack*") for folder in ("etc", "lib", "usr/lib")):
        yield judged("no udev rule of LabJack: its USB devices are root's", "install LJM with its own installer",
                     degrades=True)  # fmt: skip


def ni(at: Subject) -> Iterator[Finding]:
    """Check NI's driver and the module, where one is used."""
    if not at.options.ni:
        raise NotCheckedError("no NI module is asked for (--ni)")
    yield from _opened(at, "ni_node")


def _opened(at: Subject, node: str) -> Iterator[Finding]:
    """Open a node's device and close it. Raises AcquisitionError: no library, no device, another one."""
    values: dict[str, Any] = at.parameters[node]
    with closing(create(values["backend"], values | wired(values))) as device:
        identity = device.open()
    text = f"{identity} answers{'' if values.get('serial') else '; serial 0: any device is taken'}"
    yield judged(text, f"serial: {identity.serial}", degrades=not values.get("serial"))


def calibrations(at: Subject) -> Iterator[Finding]:
    """Check the calibration of each channel: read, of the right unit, young, from readings, plausible."""
    for values in at.parameters.values():
        if "calibrations" in values:
            found = calibrations_of(values)  # raises CalibrationError
            check_channels(found, tuple(values["channels"]))
            for calibration in found:
                yield from _judged(at, calibration)


def _judged(at: Subject, one: Calibration) -> Iterator[Finding]:
    unit = next((unit for end, unit in _UNITS.items() if one.channel.endswith(end)), one.unit)
    low, high = si_of(one, np.array(one.limits_volts))[0]
    age, reach = (datetime.date.today() - one.date).days, abs(float(high - low)) / 2.0
    few = one.readings < _READINGS or (one.residual_std or 0.0) > _RESIDUAL * reach
    problems = [
        *([f"needed: {unit}"] if unit != one.unit else []),
        *(["made in the future: one of the two dates is wrong"] if age < -1 else []),
        *([f"{age} days old"] if age > _OLD else []),
        *(["nominal figures of the data sheet"] if one.source.startswith("nominal") else ["few or bad readings"] * few),
    ]
    about = f"{one.sensor} {one.serial}, {one.date}, ±{reach:.3g} {one.unit}, {one.readings} readings"
    text = "; ".join([f"{one.channel}: {about}", *problems])
    yield judged(text, "atpid calibrate sensor (docs/stand.md, Calibration)", fails=unit != one.unit or age < -1,
                 degrades=bool(problems))  # fmt: skip
    with suppress(NotCheckedError):
        amplitude = at.scene.excitation.largest_amplitude
        if one.channel == "beam_displacement":
            amplitude = at.scene.linear_amplitude(amplitude, at.scene.frequency_hz, grain=True)
        if amplitude > reach and one.channel in ("beam_displacement", at.scene.driven_by.channel):
            yield judged(f"{one.channel}: reads ±{reach:.3g} {one.unit}, the scene's closed damper ±{amplitude:.3g}",
                         "a sensor of a larger range, or a smaller amplitude", degrades=True)  # fmt: skip
