# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration files, conversion both ways, and the command that makes a file from readings."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.cli import run_commands
from atpid_common.testing import test_every_file_has_its_notice  # noqa: F401  # is a test here too
from atpid_driver.calibration.fit import fit, read_readings
from atpid_driver.calibration.model import CalibrationError, Counts, block_si, load, save, si_of, volts_of
from atpid_driver.standins import build

main = partial(run_commands, "atpid", "", {"": {
    "calibrate sensor": ("atpid_driver.calibration.command", "sensor"),
    "calibrate reading": ("atpid_driver.calibration.reading", "reading"),
}})  # fmt: skip
SHIPPED = Path(__file__).parents[1] / "config" / "calibration"
LASER = load(SHIPPED / "laser_support.yaml")


def test_shipped_files_are_valid_and_are_the_data_sheets() -> None:
    shipped = {path.stem: load(path) for path in SHIPPED.glob("*.yaml")}
    assert {"accelerometer", "emulated_beam", "emulated_support", "laser_beam", "laser_support"} == set(shipped)
    assert si_of(LASER, np.array([1.0, 3.0, 5.0]))[0] == pytest.approx([-0.15, 0.0, 0.15])
    assert si_of(shipped["accelerometer"], np.array([0.01]))[0] == pytest.approx([9.80665])


def test_bad_values_are_nan_and_counted_by_reason() -> None:
    volts = np.array([np.nan, 0.5, 0.89, 0.95, 1.0, 3.0, 5.0, 5.2])
    values, counts = si_of(LASER, volts)
    assert np.array_equal(np.isnan(values), [True, True, True, True, False, False, False, True])
    assert counts == Counts(missing=1, broken_loop=2, out_of_range=2)
    assert counts + counts == Counts(2, 4, 4)
    beam = load(SHIPPED / "laser_beam.yaml")  # a block keeps its columns apart
    values, columns = block_si((LASER, beam), np.array([[3.0, 0.0], [4.0, 5.0]]))
    assert np.allclose(values, [[0.0, np.nan], [0.075, 0.15]], equal_nan=True)
    assert columns == (Counts(), Counts(broken_loop=1))


@given(st.lists(st.floats(-0.149, 0.149), min_size=1, max_size=20), st.floats(-1e-3, 1e-3))
def test_volts_and_back(metres: list[float], bend: float) -> None:
    for coefficients in ((-0.225, 0.075), (-0.225, 0.075, bend, bend / 10.0)):
        calibration = LASER.model_copy(update={"coefficients": coefficients})
        low, high = si_of(calibration, np.array(calibration.limits_volts))[0]
        wanted = np.clip(np.array(metres), low * 0.999, high * 0.999)
        assert si_of(calibration, volts_of(calibration, wanted))[0] == pytest.approx(wanted, abs=1e-12)
        # beyond its range an emulated sensor reads out of range
        values, counts = si_of(calibration, volts_of(calibration, np.array([-0.4, 0.4])))
        assert np.isnan(values).all()
        assert counts.out_of_range == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensitivity": 1.0}, "sensitivity"),
        ({"coefficients": [1.0]}, "coefficients"),
        ({"coefficients": [0.0, float("nan")]}, "coefficients.1"),
        ({"limits_volts": [5.0, 1.0]}, "limits_volts"),
        ({"broken_loop_volts": 2.0}, "broken_loop_volts"),
        ({"coefficients": [0.0, 1.0, -0.2]}, "two voltages"),
        ({"date": "yesterday"}, "date"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, change: dict[str, object], words: str) -> None:
    values = yaml.safe_load((SHIPPED / "laser_support.yaml").read_text())
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(values | change))
    with pytest.raises(CalibrationError, match=words) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert "bad.yaml" in str(caught.value)


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    for content in (
        b"[1, 2", b"just words", b"\xff\xfe\x00", b"[" * 50_000, b"date: 2026-13-45", b"? [a]\n: 1", b"1: 2",
        b"x" * 200_000, b"a: &a [x]\nb: [*a, *a]", b"!!python/object/apply:os.getcwd []",
    ):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(CalibrationError, match=r"bad\.yaml"):
            load(path)
    for path in (tmp_path / "none.yaml", Path("/dev/zero")):  # which is not read: it does not end
        with pytest.raises(CalibrationError, match=str(path)):
            load(path)


def test_saved_and_loaded_is_the_same(tmp_path: Path) -> None:
    save(LASER, tmp_path / "a.yaml", "note")
    assert load(tmp_path / "a.yaml") == LASER
    assert "# note" in (tmp_path / "a.yaml").read_text()


def readings(path: Path, noise: float, degree: int = 1) -> np.ndarray:
    random = np.random.default_rng(3)
    true = np.array([-0.2243, 0.0751, 2e-4, 0.0][: degree + 1])
    volts = np.repeat(np.linspace(1.1, 4.9, 9), 3)
    positions = np.polynomial.polynomial.polyval(volts, true)
    volts = volts + noise * random.standard_normal(len(volts))
    rows = "\n".join(f"{p:.9f},{v:.9f}" for p, v in zip(positions, volts, strict=True))
    path.write_text(f"# measured with a gauge block\nposition,volts\n{rows}\n")
    return true


def test_fit_finds_the_truth_within_its_error_bars(tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"
    true = readings(path, noise=4e-4)
    result = fit(*read_readings(path))
    assert (np.abs(result.coefficients - true) < 3.0 * result.coefficients_std).all()
    assert result.residual_std == pytest.approx(0.0751 * 4e-4, rel=0.4)
    assert abs(result.residuals.mean()) < 1e-12
    assert result.position_std(np.array([3.0]))[0] == pytest.approx(result.residual_std, rel=0.05)


def test_error_bars_are_those_of_repeated_measurements() -> None:
    random = np.random.default_rng(5)
    volts = np.linspace(1.0, 5.0, 12)
    fits = [fit(-0.2 + 0.08 * volts + 1e-4 * random.standard_normal(12), volts) for _ in range(800)]
    scatter = np.std([one.coefficients for one in fits], axis=0)
    stated = np.sqrt(np.mean([one.coefficients_std**2 for one in fits], axis=0))
    assert stated == pytest.approx(scatter, rel=0.1)


def test_a_cubic_is_found_exactly() -> None:
    volts = np.linspace(1.0, 5.0, 9)
    true = np.array([-0.2, 0.07, 1e-3, -1e-4])
    result = fit(np.polynomial.polynomial.polyval(volts, true), volts, 3)
    assert result.coefficients == pytest.approx(true, rel=1e-9)
    assert result.residual_std < 1e-15


@given(st.lists(st.tuples(st.floats(allow_nan=False, allow_infinity=False), st.floats(-20.0, 20.0)), max_size=12))
def test_a_fit_of_whatever_readings_is_finite_or_refused(rows: list[tuple[float, float]]) -> None:
    table = np.array(rows, dtype=np.float64).reshape(-1, 2)
    try:
        result = fit(table[:, 0], table[:, 1])
    except CalibrationError:
        return
    assert np.isfinite(result.coefficients).all()


def test_readings_are_taken_from_the_device(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    library = str(build() / "libLabJackM.so")
    for position, volts in ((-0.1, 1.5), (0.0, 3.0), (0.1, 4.5)):
        monkeypatch.setenv("ATPID_LJM_SOURCE", f"sine:offset={volts},amplitude=0.01,frequency=50")
        given = ["--position", str(position), "--terminal", "AIN0", "--library", library, "--seconds", "0.1"]
        assert main(["calibrate", "reading", str(tmp_path / "readings.csv"), *given]) == 0
    positions, measured = read_readings(tmp_path / "readings.csv")
    assert list(positions) == [-0.1, 0.0, 0.1]
    assert measured == pytest.approx([1.5, 3.0, 4.5], abs=1e-6)
    assert "scatter 7.1" in capsys.readouterr().out
    wrong = ["--position", "0", "--terminal", "AIN77", "--library", library]
    assert main(["calibrate", "reading", str(tmp_path / "x.csv"), *wrong]) == 2
    assert "AIN13" in capsys.readouterr().err


def command(tmp_path: Path, *extra: str) -> list[str]:
    fixed = ["--channel", "support_displacement", "--sensor", "Omron ZX1-LD300A81", "--serial", "A17"]
    out = str(tmp_path / "laser.yaml")
    return ["calibrate", "sensor", str(tmp_path / "readings.csv"), *fixed, "--date", "2026-11-21", "--out", out, *extra]


def test_the_command_makes_a_file_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    true = readings(tmp_path / "readings.csv", noise=4e-4)
    assert main(command(tmp_path, "--broken-loop", "0.9")) == 0
    made = load(tmp_path / "laser.yaml")
    assert made.coefficients == pytest.approx(true, rel=1e-3)
    assert (made.serial, made.readings, made.broken_loop_volts) == ("A17", 27, 0.9)
    assert made.limits_volts == pytest.approx((1.1, 4.9), abs=2e-3)
    assert (tmp_path / "laser.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(command(tmp_path)) == 2  # a calibration is not overwritten by accident
    assert "--force" in capsys.readouterr().err
    readings(tmp_path / "readings.csv", noise=4e-4, degree=2)
    for degree, hint in (("1", True), ("2", False)):  # residuals that bend are pointed out
        assert main(command(tmp_path, "--degree", degree, "--force")) == 0
        assert ("hint" in capsys.readouterr().out) == hint


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("a,b\n1,2\n", "position, volts"), ("position,volts\n0.1,x\n", "line 2"),
        ("position,volts\n0.1,nan\n", "finite"), ("position,volts\n0.1,1\n0.2,2\n", "at least 3"),
        ("position,volts\n0.1,3\n0.2,3\n0.3,3\n", "same voltage"),
        ("position,volts\n0.0,1\n0.1,2\n0.01,3\n0.09,2.5\n0.05,1.5\n", "same m"),
    ],
)  # fmt: skip
def test_bad_readings_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, words: str) -> None:
    (tmp_path / "readings.csv").write_text(content)
    degree = ("--degree", "2") if "same m" in words else ()
    assert main(command(tmp_path, *degree)) == 2
    output = capsys.readouterr().err
    assert words in output
    assert len(output.splitlines()) == 1
    assert os.listdir(tmp_path) == ["readings.csv"]
