# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A calibration from readings at known positions: least squares with error bars, and the picture of the fit."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial.polynomial import polyval, polyvander

from atpid_common.files import FileError, read_text
from atpid_driver.calibration.model import Calibration, CalibrationError, Floats

COLUMNS = ("position", "volts")
LARGEST = 1e9  # beyond it a reading is none, and its square may be no number
_MOST_BYTES = 10_000_000  # some 300 000 readings


@dataclass(frozen=True)
class Fit:
    """Polynomial position = sum c_k volts^k with what one needs to trust it.

    `coefficients`, `coefficients_std` (degree + 1,); `covariance` (degree + 1, degree + 1); `residuals` (n,) in the
    position's unit; `residual_std` their standard deviation with n - degree - 1 degrees of freedom.
    """

    volts: Floats
    positions: Floats
    coefficients: Floats
    covariance: Floats
    residuals: Floats
    residual_std: float

    @property
    def coefficients_std(self) -> Floats:
        """Standard deviation of each coefficient."""
        return np.sqrt(np.diag(self.covariance))

    def position_std(self, volts: Floats) -> Floats:
        """Standard deviation of a single converted reading at (n,) [V]: of the curve and of the reading."""
        rows = polyvander(volts, len(self.coefficients) - 1)
        curve = np.einsum("ij,jk,ik->i", rows, self.covariance, rows)
        return np.asarray(np.sqrt(curve + self.residual_std**2))


def read_readings(path: Path) -> tuple[Floats, Floats]:
    """Return positions and volts, each (n,), from a CSV file with a header naming both columns."""
    try:
        lines = read_text(path, _MOST_BYTES).splitlines()
        reader = csv.DictReader(line for line in lines if not line.lstrip().startswith("#"))
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or [])]
        if missing:
            raise CalibrationError(
                f"readings {path} have columns {reader.fieldnames}: the first line must name {', '.join(COLUMNS)}"
            )
        rows = [_row(path, reader.line_num, row) for row in reader]
    except FileError as error:
        raise CalibrationError(f"readings {error}") from None
    except csv.Error as error:
        raise CalibrationError(f"readings {path} are no CSV file: {error}") from None
    table = np.array(rows, dtype=np.float64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _row(path: Path, line: int, row: dict[str, str]) -> tuple[float, float]:
    try:
        position, volts = (float(row[name]) for name in COLUMNS)
    except (TypeError, ValueError):
        raise CalibrationError(f"readings {path}, line {line}: {dict(row)} is not two numbers") from None
    if not (np.isfinite(position) and np.isfinite(volts)):
        raise CalibrationError(f"readings {path}, line {line}: {position}, {volts} must be finite")
    return position, volts


def fit(positions: Floats, volts: Floats, degree: int = 1) -> Fit:
    """Fit positions (n,) as a polynomial of volts (n,); CalibrationError if the readings cannot decide it.

    The position is taken as known and the scatter as the sensor's; that biases the slope by the square of noise over
    range, 1e-6 for 4 mV in 4 V.
    """
    distinct = len(np.unique(positions))
    if degree < 1 or degree > 5:
        raise CalibrationError(f"degree {degree} is refused: choose 1 to 5")
    if distinct < degree + 2:
        raise CalibrationError(
            f"{distinct} different positions cannot decide and check a degree of {degree}: take at least {degree + 2}"
        )
    largest = max(np.abs(positions).max(), np.abs(volts).max())
    if not largest <= LARGEST:
        raise CalibrationError(f"readings up to {largest:g}: allowed to {LARGEST:g}; positions in SI units, volts")
    if np.ptp(volts) <= 1.0 / LARGEST:
        raise CalibrationError("all readings have the same voltage: is the sensor connected?")
    centre, scale = float(np.mean(volts)), float(np.ptp(volts)) / 2.0
    rows = polyvander((volts - centre) / scale, degree)
    scaled, _, rank, _ = np.linalg.lstsq(rows, positions, rcond=None)
    if rank <= degree:
        raise CalibrationError(f"readings at {distinct} positions do not decide a degree of {degree}: lower it")
    residuals = positions - rows @ scaled
    variance = float(residuals @ residuals) / (len(positions) - degree - 1)
    covariance = variance * np.linalg.inv(rows.T @ rows)
    back = _unscaled(degree, centre, scale)
    return Fit(volts, positions, back @ scaled, back @ covariance @ back.T, residuals, float(np.sqrt(variance)))


def _unscaled(degree: int, centre: float, scale: float) -> Floats:
    """Return the matrix that turns coefficients in (volts - centre) / scale into coefficients in volts."""
    line = np.polynomial.Polynomial([-centre / scale, 1.0 / scale])
    matrix = np.zeros((degree + 1, degree + 1))
    for power in range(degree + 1):
        matrix[: power + 1, power] = (line**power).coef
    return matrix


_PREFIXES = {"m": (1e3, "mm"), "m/s^2": (1.0, "m/s²")}
_INK, _ACCENT, _BAND = "#222222", "#b3261e", "#f2c9c5"


def draw(result: Fit, calibration: Calibration, path: Path) -> None:
    """Write the picture of a fit to `path` (PNG, SVG or PDF by its ending)."""
    from matplotlib.figure import Figure  # here: it takes a second to load

    factor, unit = _PREFIXES.get(calibration.unit, (1.0, calibration.unit))
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    volts = np.linspace(result.volts.min(), result.volts.max(), 200)
    curve = factor * polyval(volts, result.coefficients)
    above.plot(volts, curve, color=_ACCENT, linewidth=1.2, label=_formula(result, factor, unit))
    readings = f"{len(result.volts)} readings"
    above.plot(result.volts, factor * result.positions, "o", color=_INK, markersize=4, label=readings)
    above.set_ylabel(f"{calibration.channel.replace('_', ' ')} [{unit}]")
    above.set_title(f"{calibration.sensor}, serial number {calibration.serial}, {calibration.date}")
    above.legend(frameon=False)
    small, small_unit = (1e6, "µm") if calibration.unit == "m" else (factor, unit)
    band = 2.0 * small * result.position_std(volts)
    below.fill_between(volts, -band, band, color=_BAND, label="±2σ of one reading")
    below.axhline(0.0, color=_ACCENT, linewidth=1.0)
    bars = 2.0 * small * result.residual_std
    residuals, style = small * result.residuals, {"color": _INK, "markersize": 4, "elinewidth": 0.6}
    below.errorbar(result.volts, residuals, bars, fmt="o", label="readings ±2σ", **style)
    below.set_ylabel(f"residual [{small_unit}]")
    below.set_xlabel("voltage [V]")
    below.legend(frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.98), borderpad=0.0)
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#dddddd", linewidth=0.5)
    figure.savefig(path, dpi=150)


def _formula(result: Fit, factor: float, unit: str) -> str:
    terms = []
    for power, (value, std) in enumerate(zip(result.coefficients, result.coefficients_std, strict=True)):
        label = unit if power == 0 else f"{unit}/V" + ("" if power == 1 else f"$^{power}$")
        terms.append(f"$c_{power}$ = {factor * value:.5g} ± {factor * std:.2g} {label}")
    return "\n".join(terms)
