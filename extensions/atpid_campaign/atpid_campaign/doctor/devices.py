# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Checks of the stand's devices: board, LabJack, NI module, calibrations. Nothing moves."""

import grp
import os
import stat
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

from atpid_control.stand.findings import Finding, NotCheckedError, Subject, judged, judged_calibration, reach_of
from atpid_control.supervision.loop_check import Ceiling, disagreements
from atpid_driver.acquisition.protocol import wired
from atpid_driver.acquisition.registry import create
from atpid_driver.calibration.model import Calibration, calibrations_of, check_channels
from atpid_driver.motor.faults import in_words
from atpid_driver.motor.serial_actuator import SerialActuator
from atpid_driver.motor.settings import MotorSettings

_LISTED = ("dev/serial/by-id/*", "dev/ttyACM*", "dev/ttyUSB*")


def board(at: Subject) -> Iterator[Finding]:
    """Check the board's port, who holds it, and the firmware behind it, by the driver's own dialogue.

    Opening the port restarts a real board, whose motor is off then; it is asked for its identity and its state.
    """
    settings = at.settings(MotorSettings, "motor_node")
    port = Path(settings.port)
    if problem := _closed(at, port):
        yield problem
        return
    with closing(SerialActuator(settings)) as actuator:
        identity = actuator.connect(0)  # raises DriverError: silent, another firmware, limits wider than its own
        faults = in_words(actuator.observe(0).faults)
    yield judged(f"{identity} answers at {settings.port}")
    if faults:
        yield judged(f"it would not be armed: {faults}", "remove the cause (docs/motor_protocol.md)", fails=True)


def _closed(at: Subject, port: Path) -> Finding | None:
    """Return why a port cannot be opened, or must not: a program that has not locked it would be disturbed."""
    if not port.exists():
        found = [f"/{path.relative_to(at.root)}" for pattern in _LISTED for path in at.files(pattern)]
        text = f"{port} is not there; there are: {', '.join(found) or 'no serial ports'}"
        return judged(text, "plug the board in, or give --port", fails=True)
    if not stat.S_ISCHR(port.stat().st_mode):
        return judged(f"{port} is no serial port", "give --port", fails=True)
    if not os.access(port, os.R_OK | os.W_OK, effective_ids=True):
        group = "dialout"  # on other distributions uucp
        with suppress(KeyError):
            group = grp.getgrgid(port.stat().st_gid).gr_name
        mend = f"sudo usermod -aG {group} $USER, then log in again"
        return judged(f"{port} may not be opened by this user", mend, fails=True)
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
    motor = at.settings(MotorSettings, "motor_node")
    own = Ceiling(motor.lowest, motor.highest, motor.speed)
    lines = disagreements(Ceiling(*ceiling.range, ceiling.speed), own)
    text = "; ".join(lines) or "the scene's ceiling is inside the motor's range"
    yield judged(text, "change the scene, or the motor's parameter file and firmware", fails=bool(lines))


def labjack(at: Subject) -> Iterator[Finding]:
    """Check LabJack's library, the rights to its USB devices, and the T7 itself, which is opened and closed."""
    yield from _opened(at, "labjack_node")
    if not any(at.files(f"{folder}/udev/rules.d/*abjack*") for folder in ("etc", "lib", "usr/lib")):
        text = "no udev rule of LabJack: its USB devices are root's"
        yield judged(text, "install LJM with its own installer", degrades=True)


def ni(at: Subject) -> Iterator[Finding]:
    """Check NI's driver and the module, where one is used."""
    if not at.options.ni:
        raise NotCheckedError("no NI module is asked for (--ni)")
    yield from _opened(at, "ni_node")


def _opened(at: Subject, node: str) -> Iterator[Finding]:
    """Open a node's device and close it. Raises AcquisitionError: no library, no device, another one."""
    values = at.parameters[node]
    with closing(create(values["backend"], values | wired(values))) as device:
        identity = device.open()
    text = f"{identity} answers{'' if values.get('serial') else '; serial 0: any device is taken'}"
    yield judged(text, f"serial: {identity.serial}", degrades=not values.get("serial"))


def calibrations(at: Subject) -> Iterator[Finding]:
    """Check the calibration of each channel: read, of the right unit, young, from readings."""
    return map(judged_calibration, _calibrations(at))


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
            reach, amplitude = reach_of(one), reached[one.channel]
            text = f"{one.channel}: reads ±{reach:.3g} {one.unit}, the scene's closed damper ±{amplitude:.3g}"
            yield judged(text, "a sensor of a larger range, or a smaller amplitude", degrades=amplitude > reach)


def _calibrations(at: Subject) -> Iterator[Calibration]:
    """Yield the calibration of each channel. Raises CalibrationError."""
    for values in at.parameters.values():
        if "calibrations" in values:
            found = calibrations_of(values)
            check_channels(found, tuple(values["channels"]))
            yield from found
