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

from atpid_control.stand.doctor.findings import Finding, NotCheckedError, Subject, degraded, not_checked, right, wrong
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
    settings = MotorSettings(**{key: value for key, value in values.items()
                                if key in MotorSettings.__dataclass_fields__})  # fmt: skip
    if settings.backend != "serial":
        yield not_checked(f"the motor's backend is {settings.backend}")
        return
    yield from _ceiling(at, settings)
    port = Path(settings.port)
    if not port.exists():
        found = [f"/{path.relative_to(at.root)}" for pattern in _LISTED for path in at.files(pattern)]
        yield wrong(f"{settings.port} is not there; there are: {', '.join(found) or 'no serial ports'}",
                    "plug the board in, or give --port")  # fmt: skip
        return
    if not stat.S_ISCHR(port.stat().st_mode):
        yield wrong(f"{settings.port} is no serial port", "give --port")
        return
    if not os.access(port, os.R_OK | os.W_OK, effective_ids=True):
        yield wrong(f"{settings.port} may not be opened by this user",
                    f"sudo usermod -aG {_group(port)} $USER, then log in again")  # fmt: skip
        return
    if holders := _holders(at, port):
        yield wrong(f"{settings.port} is held by {', '.join(holders)}", "end it first")
        return
    with closing(SerialActuator(settings)) as actuator:
        identity = actuator.connect(0)  # raises MotorError: silent, another firmware, limits wider than its own
        reading = actuator.observe(0)
    yield right(f"{identity.name} {identity.version} answers at {settings.port}")
    if reading.faults:
        yield wrong(f"it would not be armed: {in_words(reading.faults)}", "remove the cause (docs/motor_protocol.md)")


def _group(port: Path) -> str:
    """Return the group that may open a port: dialout, on other distributions uucp."""
    with suppress(KeyError):
        return grp.getgrgid(port.stat().st_gid).gr_name
    return "dialout"


def _ceiling(at: Subject, settings: MotorSettings) -> Iterator[Finding]:
    """Compare the scene's ceiling with the motor node's, which has to lie inside the firmware's."""
    try:
        ceiling = at.scene.ceiling
    except NotCheckedError:
        return
    if ceiling.controlled:
        limits = settings.limits
        motor = Ceiling(limits.lowest, limits.highest, limits.speed)
        for line in disagreements(Ceiling(*ceiling.range, ceiling.speed), motor):
            yield wrong(line, "change the scene, or the motor's parameter file and firmware")


def _holders(at: Subject, port: Path) -> list[str]:
    """Return the programs that have a port open, as far as this user may see."""
    device, found = port.resolve(), []
    for process in at.files("proc/[0-9]*"):
        with suppress(OSError):
            if any(os.readlink(entry) == str(device) for entry in (process / "fd").iterdir()):
                found.append(f"{(process / 'comm').read_text().strip()} (process {process.name})")
    return found


def labjack(at: Subject) -> Iterator[Finding]:
    """Check LabJack's library, the rights to its USB devices, and the T7 itself, which is opened and closed."""
    yield from _opened(at, "labjack_node")
    if at.parameters["labjack_node"].get("connection", "ANY") in ("ANY", "USB"):
        rules = [path for folder in ("etc", "lib", "usr/lib") for path in at.files(f"{folder}/udev/rules.d/*abjack*")]
        if not rules:
            yield degraded("no udev rule of LabJack: its USB devices are root's", "install LJM with its own installer")


def ni(at: Subject) -> Iterator[Finding]:
    """Check NI's driver and the module, where one is used."""
    if at.options.ni:
        yield from _opened(at, "ni_node")
    else:
        yield not_checked("no NI module is asked for (--ni)")


def _opened(at: Subject, node: str) -> Iterator[Finding]:
    """Open a node's device and close it. Raises AcquisitionError: no library, no device, another one."""
    values: dict[str, Any] = at.parameters[node]
    with closing(create(values["backend"], values | wired(values))) as device:
        identity = device.open()
    yield right(f"{identity} answers")
    if not values.get("serial"):
        yield degraded("serial 0: any device is taken", f"serial: {identity.serial}")


def calibrations(at: Subject) -> Iterator[Finding]:
    """Check the calibration of each channel: read, of the right unit, young, from readings, plausible."""
    for node in ("labjack_node", "ni_node"):
        if (values := at.parameters.get(node)) is None:
            continue
        found = calibrations_of(values)  # raises CalibrationError
        check_channels(found, tuple(values["channels"]))
        for calibration in found:
            problems = list(_judged(at, calibration))
            yield from problems or [right(f"{calibration.channel}: {calibration.sensor}, {calibration.date}")]


def _judged(at: Subject, one: Calibration) -> Iterator[Finding]:
    again = "atpid calibrate sensor (docs/stand.md, Calibration)"
    unit = next((unit for end, unit in _UNITS.items() if one.channel.endswith(end)), one.unit)
    if one.unit != unit:
        yield wrong(f"{one.channel}: in {one.unit}; needed: {unit}", again)
    age = (datetime.date.today() - one.date).days
    if age < -1:
        yield wrong(f"{one.channel}: of {one.date}, which is to come", "correct the clock, or the file's date")
    elif age > _OLD:
        yield degraded(f"{one.channel}: {age} days old", again)
    ends = si_of(one, _limits(one))[0]
    reach = abs(float(ends[1] - ends[0])) / 2.0
    if one.source.startswith("nominal"):
        yield degraded(f"{one.channel}: nominal figures of the data sheet, no calibration", again)
    elif one.readings < _READINGS or (one.residual_std or 0.0) > _RESIDUAL * reach:
        scatter = f"residual {one.residual_std or 0.0:.2g} {one.unit} of a range of ±{reach:.2g}"
        yield degraded(f"{one.channel}: {one.readings} readings, {scatter}", again)
    yield from _reached(at, one, reach)


def _limits(one: Calibration) -> Any:
    import numpy as np

    return np.array(one.limits_volts)


def _reached(at: Subject, one: Calibration, reach: float) -> Iterator[Finding]:
    """Compare a displacement's range with what moves in the scene, closed, at its own frequency."""
    try:
        scene = at.scene
    except NotCheckedError:
        return
    amplitude = scene.excitation.largest_amplitude
    if one.channel == "beam_displacement" and scene.excitation.is_tone:
        amplitude = scene.linear_amplitude(amplitude, scene.frequency_hz, grain=True)
    elif one.channel != scene.driven_by.channel:
        return
    if amplitude > reach:
        yield degraded(f"{one.channel}: reads ±{reach:.3g} {one.unit}, the scene's closed damper ±{amplitude:.3g}",
                       "a sensor of a larger range, or a smaller amplitude")  # fmt: skip
