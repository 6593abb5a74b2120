# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Checks of the stand's devices: board, LabJack, NI module, exciter, calibrations. Nothing moves."""

import datetime
import grp
import os
import stat
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from atpid_campaign.doctor.findings import Finding, NotCheckedError, Subject, judged
from atpid_campaign.doctor.software import running
from atpid_control.stand.errors import BenchError
from atpid_control.supervision.loop_check import Ceiling, disagreements
from atpid_driver.acquisition.registry import create
from atpid_driver.acquisition.settings import wired
from atpid_driver.calibration.convert import calibrations_of, check_channels, shipped_calibrations, si_of
from atpid_driver.calibration.model import Calibration
from atpid_driver.excitation import ExcitationSettings, drive_of
from atpid_driver.excitation.outlets import calibration_of
from atpid_driver.motor.faults import in_words
from atpid_driver.motor.serial_actuator import SerialActuator
from atpid_driver.motor.settings import MotorSettings

#: A calibration is made anew after this many days; readings that one needs; its residual over its range [-].
_OLD, _READINGS, _RESIDUAL = 365, 7, 0.01
#: Units by the end of a channel's name.
_UNITS = {"displacement": "m", "acceleration": "m/s^2", "force": "N"}
_LISTED = ("dev/serial/by-id/*", "dev/ttyACM*", "dev/ttyUSB*")

S = TypeVar("S", MotorSettings, ExcitationSettings)


def board(at: Subject) -> Iterator[Finding]:
    """Check the board's port, who holds it, and the firmware behind it, by the driver's own dialogue.

    Opening the port restarts a real board, whose motor is off then; it is asked for its identity and its state.
    """
    settings = _settings(at, MotorSettings, "motor_node")
    port = Path(settings.port)
    if problem := _closed(at, port):
        yield problem
        return
    with closing(SerialActuator(settings)) as actuator:
        identity = actuator.connect(0)  # raises DriverError: silent, another firmware, limits wider than its own
        faults = in_words(actuator.observe(0).faults)
    yield judged(f"{identity.name} {identity.version} answers at {settings.port}")
    if faults:
        yield judged(f"it would not be armed: {faults}", "remove the cause (docs/motor_protocol.md)", fails=True)


def _settings(at: Subject, kind: type[S], node: str) -> S:
    """Return a device's settings. Raises DriverError for an invalid one, BenchError where one is missing."""
    values = at.parameters[node]
    try:
        return kind(**{one.name: values[one.name] for one in fields(kind) if one.init and one.name in values})
    except TypeError as error:
        raise BenchError(f"{node}: {error}; give them in its parameter file") from None


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


def travel(at: Subject) -> Iterator[Finding]:
    """Compare the scene's ceiling with the motor node's, which has to lie inside the firmware's."""
    if not (ceiling := at.scene.ceiling).controlled:
        raise NotCheckedError("the scene's ceiling has no controller")
    motor = _settings(at, MotorSettings, "motor_node")
    own = Ceiling(motor.lowest, motor.highest, motor.speed)
    lines = disagreements(Ceiling(*ceiling.range, ceiling.speed), own)
    yield judged("; ".join(lines) or "the scene's ceiling is inside the motor's range",
                 "change the scene, or the motor's parameter file and firmware", fails=bool(lines))  # fmt: skip


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


def exciter(at: Subject) -> Iterator[Finding]:
    """Check the exciter's settings, its calibration, and its device, which is opened, its output off, and closed."""
    if not at.options.excitation_config:
        raise NotCheckedError("no exciter is driven (--excitation-config)")
    settings = _settings(at, ExcitationSettings, "excitation_node")
    if settings.backend != "simulated":
        yield _judged(calibration_of(settings, shipped_calibrations()))  # raises CalibrationError
    if "excitation_node" in running(at):
        raise NotCheckedError("excitation_node runs: its output would be switched off")
    with closing(drive_of(settings, shipped_calibrations)) as drive:
        yield judged(f"{drive.connect()} answers")  # raises DriverError


def calibrations(at: Subject) -> Iterator[Finding]:
    """Check the calibration of each channel: read, of the right unit, young, from readings."""
    return map(_judged, _calibrations(at))


def ranges(at: Subject) -> Iterator[Finding]:
    """Compare what the sensors can read with what the scene reaches, its damper closed."""
    driven = at.scene.driven_by.channel
    largest = at.scene.excitation.largest_amplitude
    reached = {
        driven: largest,
        "beam_displacement": at.scene.linear_amplitude(largest, at.scene.frequency_hz, grain=True),
    }
    for one in _calibrations(at):
        if one.channel in reached:
            reach, amplitude = _reach(one), reached[one.channel]
            yield judged(f"{one.channel}: reads ±{reach:.3g} {one.unit}, the scene's closed damper ±{amplitude:.3g}",
                         "a sensor of a larger range, or a smaller amplitude", degrades=amplitude > reach)  # fmt: skip


def _calibrations(at: Subject) -> Iterator[Calibration]:
    """Yield the calibration of each channel. Raises CalibrationError."""
    for values in at.parameters.values():
        if "calibrations" in values:
            found = calibrations_of(values)
            check_channels(found, tuple(values["channels"]))
            yield from found


def _reach(one: Calibration) -> float:
    """Return half the range of a calibration, in its unit."""
    low, high = si_of(one, np.array(one.limits_volts))[0]
    return abs(float(high - low)) / 2.0


def _judged(one: Calibration) -> Finding:
    unit = next((unit for end, unit in _UNITS.items() if one.channel.endswith(end)), one.unit)
    age, reach = (datetime.date.today() - one.date).days, _reach(one)
    nominal, few = one.source.startswith("nominal"), one.readings < _READINGS
    problems = {
        f"needed: {unit}": unit != one.unit,
        "made in the future: one of the two dates is wrong": age < -1,
        f"{age} days old": age > _OLD,
        "nominal figures of the data sheet": nominal,
        "few or bad readings": not nominal and (few or (one.residual_std or 0.0) > _RESIDUAL * reach),
    }
    about = f"{one.sensor} {one.serial}, {one.date}, ±{reach:.3g} {one.unit}, {one.readings} readings"
    text = "; ".join([f"{one.channel}: {about}", *(name for name, there in problems.items() if there)])
    return judged(text, "atpid calibrate sensor (docs/stand.md, Calibration)", fails=unit != one.unit or age < -1,
                  degrades=any(problems.values()))  # fmt: skip
