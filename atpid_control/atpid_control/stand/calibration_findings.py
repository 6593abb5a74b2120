# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a check of `atpid doctor` finds on a calibration: its unit, its age, and from what it was made."""

import datetime

import numpy as np

from atpid_control.stand.findings import Finding, judged
from atpid_driver.calibration.model import Calibration, si_of

#: A calibration is made anew after this many days; readings that one needs; its residual over its range [-].
_OLD, _READINGS, _RESIDUAL = 365, 7, 0.01
#: Units by the end of a channel's name.
_UNITS = {"displacement": "m", "acceleration": "m/s^2", "force": "N"}


def reach_of(one: Calibration) -> float:
    """Return half the range of a calibration, in its unit."""
    low, high = si_of(one, np.array(one.limits_volts))[0]
    return abs(float(high - low)) / 2.0


def judged_calibration(one: Calibration) -> Finding:
    """Return what is found on a calibration: of the right unit, young, from readings."""
    unit = next((unit for end, unit in _UNITS.items() if one.channel.endswith(end)), one.unit)
    age, reach = (datetime.date.today() - one.date).days, reach_of(one)
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
