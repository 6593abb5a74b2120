# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What docs/identification.md says and shows is true of the code and of the parameter file."""

import argparse
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure

from atpid_control.identification import linear
from studies.figures import identification as figures
from studies.identification import measure as showcase

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "identification.md").read_text(encoding="utf-8")


def test_the_pictures_are_made_with_the_parameter_file_s_values() -> None:
    text = (ROOT / "atpid_control" / "config" / "identifier.yaml").read_text(encoding="utf-8")
    said = yaml.safe_load(text)["/**/identifier_node"]["ros__parameters"]
    for name, value in vars(showcase.SETTINGS).items():
        assert name == "saturation" or said[name] == value, name
    for name, value in vars(showcase.RUMBLE).items():
        assert said[f"rumble_{name}"] == value, name


def test_the_page_shows_every_picture_and_every_picture_is_there() -> None:
    shown = set(re.findall(r"figures/(identification_\w+)\.png", PAGE))
    assert shown == {f"identification_{name}" for name in figures.FIGURES}
    assert all((ROOT / "docs" / "figures" / f"{name}.png").stat().st_size > 10_000 for name in shown)


def test_spoiled_signals_stay_within_a_per_cent() -> None:
    names, plain, ours = showcase.spoiled_errors(trials=15)
    assert ours.max() < 0.01, dict(zip(names, ours, strict=True))
    assert plain.max() > 0.02


def test_the_fft_bin_is_wrong_between_whole_periods() -> None:
    periods, errors = showcase.errors_over_window(40.0, trials=60)
    ratio = errors["four-parameter sine fit"] / errors["Cramér-Rao bound"]
    assert ratio.max() < 1.35  # sixty trials scatter by a tenth
    assert 0.25 < errors["FFT bin (thesis)"].max() < 0.40
    assert periods[0] == 1.0


def test_the_courses_are_distinguished() -> None:
    safe, high = showcase.watched_courses().values()
    assert safe.alarms == []
    assert np.nanmax(safe.scatter) < 0.045
    assert len(high.alarms) == 2
    assert np.nanmax(high.scatter) > 0.12


def test_the_command_writes_the_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "FIGURES", {"ramps": figures.draw_ramps})
    parser = argparse.ArgumentParser()
    figures.add_arguments(parser)
    assert figures.run(parser.parse_args(["--out", str(tmp_path / "new")])) == 0
    assert (tmp_path / "new" / "identification_ramps.png").stat().st_size > 10_000
    assert isinstance(figures.draw_watch(), Figure)


def test_the_cache_of_compiled_functions_covers_all_their_sources() -> None:
    package = ROOT / "atpid_control" / "atpid_control"
    users = {path.stem for path in package.rglob("*.py") if "\n@compiled\n" in path.read_text(encoding="utf-8")}
    assert users == set(linear.KERNELS)
