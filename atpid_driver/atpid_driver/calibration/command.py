# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid calibrate sensor`: a calibration file and its picture from readings at known positions."""

import argparse
import datetime
from contextlib import suppress
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from atpid_common import output
from atpid_common.arguments import file_path, path_to, real, refuse, whole, word
from atpid_driver.calibration.fit import Fit, fit, read_readings
from atpid_driver.calibration.model import Calibration, CalibrationError, save

#: Arguments of the example in the help.
EXAMPLE = "readings.csv --channel support_displacement --sensor optoNCDT-1420 --serial 17 --out laser.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("readings", type=file_path, help="CSV file with the columns position (SI) and volts")
    parser.add_argument(
        "--channel", type=word, required=True, help="name in the messages, for example support_displacement"
    )
    parser.add_argument("--sensor", type=word, required=True, help="make and model")
    parser.add_argument("--serial", type=word, required=True, help="serial number on the sensor")
    parser.add_argument("--unit", type=word, default="m", help="SI unit of the positions (default: m)")
    parser.add_argument("--degree", type=whole(1, 5), default=1, help="degree of the polynomial (default: 1)")
    parser.add_argument(
        "--limits", type=real(-1e3, 1e3, "V"), nargs=2, metavar=("LOW", "HIGH"), help="valid volts (default: as read)"
    )
    parser.add_argument(
        "--broken-loop", type=real(-1e3, 1e3, "V"), metavar="VOLTS", help="below this a 4-20 mA loop is broken"
    )
    parser.add_argument("--date", type=_date, default=None, help="YYYY-MM-DD (default: today)")
    parser.add_argument(
        "--out", type=path_to(".yaml", ".yml"), required=True, metavar="FILE.yaml", help="file to write"
    )
    parser.add_argument("--picture", type=path_to(".png"), help="picture to write (default: beside --out, .png)")
    parser.add_argument("--force", action="store_true", help="replace --out and --picture where they exist")


def _date(text: str) -> datetime.date:
    with suppress(ValueError):
        return datetime.date.fromisoformat(text)
    return refuse(text, "a date YYYY-MM-DD")


def run(arguments: argparse.Namespace) -> int:
    """Fit, write both files and print the residuals; CalibrationError for readings that cannot be used."""
    out: Path = arguments.out
    if out.exists() and not arguments.force:
        raise CalibrationError(f"{out} exists: a calibration is kept; name another file or pass --force")
    output.file(out)
    picture = output.file(arguments.picture or out.with_suffix(".png"), "--picture", replace=arguments.force)
    positions, volts = read_readings(arguments.readings)
    result = fit(positions, volts, arguments.degree)
    calibration = calibration_of(result, arguments)
    from atpid_driver.calibration.fit import draw  # matplotlib takes a second to load

    comment = f"Made from {arguments.readings.name} by `atpid calibrate sensor`."
    with output.writing(out):
        save(calibration, out, comment)
    with output.writing(picture, "--picture"):
        draw(result, calibration, picture)
    print(table(result, calibration.unit))
    if hint := _curvature_hint(result):
        print(hint)
    print(f"calibration {out}\npicture     {picture}")
    return 0


def calibration_of(result: Fit, arguments: argparse.Namespace) -> Calibration:
    """Return the calibration of a fit; CalibrationError if the curve turns back within the limits."""
    limits = tuple(arguments.limits or (float(result.volts.min()), float(result.volts.max())))
    try:
        return Calibration(
            **{name: getattr(arguments, name) for name in ("channel", "sensor", "serial", "unit")},
            date=arguments.date or datetime.date.today(),
            source=f"{len(result.volts)} readings, {arguments.readings.name}",
            coefficients=tuple(float(value) for value in result.coefficients),
            coefficients_std=tuple(float(value) for value in result.coefficients_std),
            limits_volts=limits,
            broken_loop_volts=arguments.broken_loop,
            residual_std=result.residual_std,
            readings=len(result.volts),
        )
    except ValidationError as error:
        raise CalibrationError(f"{arguments.readings}: {error.errors()[0]['msg']}") from None


def _curvature_hint(result: Fit) -> str:
    """Return a hint where one degree more explains the residuals (by four standard deviations); empty otherwise."""
    degree = len(result.coefficients)
    if degree > 5 or len(np.unique(result.positions)) < degree + 2:
        return ""
    higher = fit(result.positions, result.volts, degree)
    if abs(higher.coefficients[-1]) < 4.0 * higher.coefficients_std[-1]:
        return ""
    return (
        f"hint: the residuals bend; degree {degree} would leave {higher.residual_std:.3g} instead of "
        f"{result.residual_std:.3g}"
    )


def table(result: Fit, unit: str) -> str:
    """Return the readings with residuals and error bars, and the coefficients, as text."""
    std = result.position_std(result.volts)
    lines = [f"{'volts [V]':>12} {f'position [{unit}]':>16} {f'residual [{unit}]':>16} {f'one sigma [{unit}]':>17}"]
    rows = zip(result.volts, result.positions, result.residuals, std, strict=True)
    lines += [f"{v:12.5f} {p:16.6g} {r:16.2e} {s:17.2e}" for v, p, r, s in rows]
    pairs = zip(result.coefficients, result.coefficients_std, strict=True)
    lines += [f"c{power} = {value:.8g} +- {s:.2g} {unit}/V^{power}" for power, (value, s) in enumerate(pairs)]
    worst = float(np.abs(result.residuals).max())
    lines.append(f"residuals: standard deviation {result.residual_std:.3g} {unit}, largest {worst:.3g} {unit}")
    return "\n".join(lines)
