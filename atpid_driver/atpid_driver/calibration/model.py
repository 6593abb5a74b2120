# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A sensor's calibration: its YAML file, volts to SI and back, and the calibrations of a node's channels."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from atpid_common.files import Document, FileError, parse_yaml, read_text
from atpid_common.folders import share_folder
from atpid_driver import DriverError

_MOST_BYTES = 100_000  # the longest of ours has some hundreds


class CalibrationError(DriverError):
    """A calibration file or a set of readings cannot be used."""


class Calibration(BaseModel):
    """How one channel's voltage becomes a quantity in SI units.

    quantity = sum over k of coefficients[k] * volts**k. Outside `limits_volts` the sensor is out of its range, below
    `broken_loop_volts` its current loop is broken: both give NaN.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    channel: Annotated[str, Field(min_length=1)]
    sensor: Annotated[str, Field(min_length=1)]
    serial: Annotated[str, Field(min_length=1)]
    date: datetime.date
    source: Annotated[str, Field(min_length=1)]  # where the figures come from: a data sheet (nominal) or readings
    unit: Annotated[str, Field(min_length=1)]
    coefficients: Annotated[tuple[FiniteFloat, ...], Field(min_length=2, max_length=6)]  # [unit, unit/V, unit/V^2, ...]
    coefficients_std: tuple[FiniteFloat, ...] | None = None
    limits_volts: tuple[FiniteFloat, FiniteFloat]
    broken_loop_volts: FiniteFloat | None = None
    residual_std: Annotated[FiniteFloat, Field(ge=0.0)] | None = None
    """Standard deviation of the readings about the fit [unit]."""
    readings: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _consistent(self) -> Calibration:
        low, high = self.limits_volts
        if low >= high:
            raise ValueError(f"limits_volts [{low}, {high}] must be [low, high]")
        if self.broken_loop_volts is not None and self.broken_loop_volts > low:
            raise ValueError(f"broken_loop_volts {self.broken_loop_volts} must not lie above the lower limit {low}")
        if self.coefficients_std is not None and len(self.coefficients_std) != len(self.coefficients):
            raise ValueError("coefficients_std must have as many entries as coefficients")
        with np.errstate(all="ignore"):
            ends = polyval(np.array([low, high]), np.asarray(self.coefficients))
            slopes = polyval(np.linspace(low, high, 257), polyder(self.coefficients))
        if not np.isfinite(ends).all():
            raise ValueError(f"coefficients give no finite {self.unit} at limits_volts [{low}, {high}]")
        if not ((slopes > 0.0).all() or (slopes < 0.0).all()):
            raise ValueError(f"coefficients give the same {self.unit} for two voltages between {low} and {high} V")
        return self


def load(path: Path) -> Calibration:
    """Read a calibration file; CalibrationError names the file, the key, what was given and what is allowed."""
    try:
        text = read_text(path, _MOST_BYTES)
    except FileError as error:
        raise CalibrationError(f"calibration file {error}") from None
    try:
        values = parse_yaml(text)
    except FileError as error:
        raise CalibrationError(f"calibration file {path} is {error}") from None
    if not isinstance(values, dict):
        raise CalibrationError(f"calibration file {path} must be a table of keys, it is a {type(values).__name__}")
    try:
        return Calibration.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        value = "nothing" if first["type"] == "missing" else repr(first["input"])
        given = f"{key} was given {value}: " if key else ""
        raise CalibrationError(f"calibration file {path}: {given}{first['msg']}") from None


def save(calibration: Calibration, path: Path, comment: str = "") -> None:
    """Write a calibration file, with `comment` lines at its top."""
    values = calibration.model_dump(exclude_none=True)
    plain = {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
    head = "".join(f"# {line}\n" for line in ["SPDX-License-Identifier: Apache-2.0", *comment.splitlines()])
    path.write_text(
        head + yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, default_flow_style=None), encoding="utf-8"
    )


Floats = NDArray[np.float64]
#: Readings of a channel without calibration file are within it.
_MOST = 1e12


@dataclass(frozen=True)
class Counts:
    """How many values of a block could not be used, by reason."""

    missing: int = 0  # NaN already: the device lost the scan
    broken_loop: int = 0
    out_of_range: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.missing + other.missing,
            self.broken_loop + other.broken_loop,
            self.out_of_range + other.out_of_range,
        )


def si_of(calibration: Calibration, volts: Floats) -> tuple[Floats, Counts]:
    """Return the quantity [calibration.unit] for (n,) [V], NaN where there is none, and the counts of those."""
    values = np.asarray(polyval(volts, np.asarray(calibration.coefficients)), dtype=np.float64)
    low, high = calibration.limits_volts
    outside = (volts < low) | (volts > high)
    if not outside.any():
        return values, Counts(missing=int(np.isnan(volts).sum()))
    values[outside] = np.nan
    threshold = -np.inf if calibration.broken_loop_volts is None else calibration.broken_loop_volts
    broken = int((volts < threshold).sum())
    return values, Counts(int(np.isnan(volts).sum()), broken, int(outside.sum()) - broken)


def block_si(calibrations: tuple[Calibration, ...], volts: Floats) -> tuple[Floats, tuple[Counts, ...]]:
    """Return (n_scans, n_channels) in SI for (n_scans, n_channels) [V] and each channel's counts."""
    pairs = [si_of(calibration, column) for calibration, column in zip(calibrations, volts.T, strict=True)]
    return np.column_stack([values for values, _ in pairs]), tuple(counts for _, counts in pairs)


def volts_of(calibration: Calibration, quantity: Floats) -> Floats:
    """Return the voltage the sensor gives for a quantity (n,) [calibration.unit]: what an emulated stand feeds.

    Beyond its range a 4-20 mA sensor holds its last value, so the voltage is held just outside the limit.
    """
    low, high = calibration.limits_volts
    margin = 0.01 * (high - low)
    if len(calibration.coefficients) == 2:
        offset, slope = calibration.coefficients
        volts = (quantity - offset) / slope
    else:
        volts = _inverse(calibration, quantity)
    return np.clip(volts, low - margin, high + margin)


def _inverse(calibration: Calibration, quantity: Floats) -> Floats:
    """Newton from the straight line through the limits; the calibration is monotonic there."""
    low, high = calibration.limits_volts
    coefficients = np.asarray(calibration.coefficients)
    slope = coefficients[1:] * np.arange(1, len(coefficients))
    ends = polyval(np.array([low, high]), coefficients)
    target = np.clip(quantity, ends.min(), ends.max())
    volts = low + (target - ends[0]) / (ends[1] - ends[0]) * (high - low)
    for _ in range(50):
        step = (polyval(volts, coefficients) - target) / polyval(volts, slope)
        volts = np.clip(volts - step, low, high)
        if not step.size or np.abs(step).max() < 1e-12 * (high - low):
            break
    beyond = 0.02 * (high - low) * np.sign(ends[1] - ends[0])
    side = (quantity > ends.max()).astype(np.float64) - (quantity < ends.min())
    return np.asarray(volts + side * beyond)


def check_channels(calibrations: tuple[Calibration, ...], channels: tuple[str, ...]) -> None:
    """CalibrationError unless each channel has its own calibration, in the same order."""
    for name, calibration in zip(channels, calibrations, strict=False):
        if calibration.channel != name:
            raise CalibrationError(
                f"channel {name} was given the calibration of {calibration.channel}: put `calibrations` in the order "
                "of `channels`"
            )
    if len(calibrations) != len(channels):
        raise CalibrationError(
            f"{len(channels)} channels need as many calibrations, {len(calibrations)} were given: one file each"
        )


def calibrations_of(values: Document) -> tuple[Calibration, ...]:
    """Return those of the parameters `units` and `factors`, or of the files in `calibrations`. Raises DriverError."""
    if any(values.get("units", ())):
        return _stated(values)
    if not any(values["calibrations"]):
        raise CalibrationError("calibrations: none given; give a file for each channel, or units and factors")
    folder = Path(values["calibration_folder"]) if values.get("calibration_folder") else shipped_calibrations()
    return tuple(load(folder / name) for name in values["calibrations"])


def shipped_calibrations() -> Path:
    """Return the folder of the installed calibration files; InputError where no sourced workspace has them."""
    return share_folder("atpid_driver") / "config" / "calibration"


def _stated(values: Document) -> tuple[Calibration, ...]:
    """Return calibrations from the parameters `units` and `factors`. Raises CalibrationError."""
    names, units, factors = list(values["channels"]), list(values["units"]), list(values["factors"])
    factors *= len(names) if len(factors) == 1 else 1
    if any(values["calibrations"]) or not len(units) == len(factors) == len(names) or not all(units) or 0.0 in factors:
        raise CalibrationError(
            f"units {units}, factors {factors}: give one of each for a channel, factors not 0, and no calibrations"
        )
    source, limits = "parameters units and factors", (-_MOST, _MOST)
    known: Document = {"sensor": "as stated", "serial": "none", "source": source, "limits_volts": limits}
    return tuple(
        Calibration(channel=name, unit=unit, coefficients=(0.0, factor), date=date.today(), **known)
        for name, unit, factor in zip(names, units, factors, strict=True)
    )
