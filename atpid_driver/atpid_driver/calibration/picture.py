# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a calibration: readings and curve above, residuals with error bars below."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.polynomial.polynomial import polyval

from atpid_driver.calibration.fit import Fit
from atpid_driver.calibration.model import Calibration

PREFIXES = {"m": (1e3, "mm"), "m/s^2": (1.0, "m/s²")}
INK, ACCENT, BAND = "#222222", "#b3261e", "#f2c9c5"


def draw(result: Fit, calibration: Calibration, path: Path) -> None:
    """Write the picture of a fit to `path` (PNG, SVG or PDF by its ending)."""
    factor, unit = PREFIXES.get(calibration.unit, (1.0, calibration.unit))
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    volts = np.linspace(result.volts.min(), result.volts.max(), 200)
    curve = factor * polyval(volts, result.coefficients)
    above.plot(volts, curve, color=ACCENT, linewidth=1.2, label=_formula(result, factor, unit))
    readings = f"{len(result.volts)} readings"
    above.plot(result.volts, factor * result.positions, "o", color=INK, markersize=4, label=readings)
    above.set_ylabel(f"{calibration.channel.replace('_', ' ')} [{unit}]")
    above.set_title(f"{calibration.sensor}, serial number {calibration.serial}, {calibration.date}")
    above.legend(frameon=False)
    small, small_unit = (1e6, "µm") if calibration.unit == "m" else (factor, unit)
    band = 2.0 * small * result.position_std(volts)
    below.fill_between(volts, -band, band, color=BAND, label="±2σ of one reading")
    below.axhline(0.0, color=ACCENT, linewidth=1.0)
    bars = 2.0 * small * result.residual_std
    residuals, style = small * result.residuals, {"color": INK, "markersize": 4, "elinewidth": 0.6}
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
