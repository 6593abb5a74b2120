# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A sensor's calibration, as its YAML file holds it."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from numpy.polynomial.polynomial import polyder, polyval
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from atpid_common.files import FileError, parse_yaml, read_text
from atpid_driver import DriverError

MOST_BYTES = 100_000  # the longest of ours has some hundreds


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
        text = read_text(path, MOST_BYTES)
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
