# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Exports of what is unusual: odd names, one sample, extreme numbers, texts in any script, a restart, several files."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import pyuff
from exported import EXACT, RATE, START, run, samples
from recorded import block, make
from scipy.io import loadmat

from atpid_control.cli import main
from atpid_control.runs.metadata import new_run
from atpid_control.runs.run import open_run
from atpid_control.runs.writer import BagWriter

NAMES = ["Weg, oben", "time", "a#b", 'größe "µ"', "x" * 70]
UNITS = ["mm", "", "m/s²", "V", "N"]
TEXT = 'Größe µ "x", #1\nzweite Zeile\r\n日本語 ☃ \t;'
EXTREME = np.array([[5e-324, -0.0], [1e11, -1e11], [np.nan, np.nextafter(1.0, 2.0)], [0.1 + 0.2, 1.0 / 3.0]])


def recording(folder: Path, blocks: list[bytes], text: str = "") -> Path:
    writer = BagWriter(folder, new_run(run_id="odd", commit="none"))
    writer.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    writer.add_topic("/events", "atpid_interfaces/msg/Event")
    for place, one in enumerate(blocks):
        at = START + place * 50_000_000
        writer.write("/sensors/laser", one, at, at)
    if text:
        event = make("Event", START, "knöten", kind="note", value=1.0, text=text)
        writer.write("/events", event, START, START)
    writer.close({"finished": "yes"})
    return folder


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = samples(np.arange(50), 5)
    named = block(0, data, RATE, START, channels=NAMES, units=UNITS, skew=np.zeros(5))
    return recording(tmp_path_factory.mktemp("odd") / "run", [named], TEXT)


def test_csv_keeps_names_that_hold_signs_of_its_own(odd: Path, tmp_path: Path) -> None:
    table = pd.read_csv(run(odd, "csv", tmp_path / "a.csv"), comment="#", **EXACT)
    shown = ["Weg, oben [mm]", "time_1", "a#b [m/s²]", 'größe "µ" [V]', f"{'x' * 70} [N]"]
    assert list(table)[3:] == shown
    np.testing.assert_array_equal(table[shown], samples(np.arange(50), 5))
    np.testing.assert_array_equal(table["index"], np.arange(50))


def test_matlab_has_names_it_takes_and_those_of_the_bag(odd: Path, tmp_path: Path) -> None:
    laser = loadmat(run(odd, "mat", tmp_path / "a.mat"), simplify_cells=True)["sensors_laser"]
    fields = [name for name in laser if name in laser["names"]][3:]
    assert [laser["names"][name] for name in fields] == ["Weg, oben", "time_1", "a#b", 'größe "µ"', "x" * 70]
    assert all(name.isascii() and name.isidentifier() and len(name) < 64 for name in fields)
    np.testing.assert_array_equal(np.column_stack([laser[name] for name in fields]), samples(np.arange(50), 5))


def test_uff_has_lines_of_80_signs_and_double_values(odd: Path, tmp_path: Path) -> None:
    path = run(odd, "uff", tmp_path / "a.uff")
    records = [one for one in pyuff.UFF(path).read_sets() if one["type"] == 58]
    np.testing.assert_array_equal(np.column_stack([one["data"] for one in records]), samples(np.arange(50), 5))
    assert [one["ordinate_axis_units_lab"] for one in records] == ["mm", "NONE", "m/s?", "V", "N"]
    for part in Path(path).read_bytes().split(b"\n    58b")[1:]:
        assert all(len(line) <= 80 for line in part.split(b"\n")[:12])


def test_a_text_in_any_script_comes_back(odd: Path, tmp_path: Path) -> None:
    run(odd, "csv", tmp_path / "a.csv")
    events = pd.read_csv(tmp_path / "a.events.csv", comment="#", lineterminator="\n", keep_default_na=False)
    assert (events["text"].item(), events["node"].item()) == (TEXT, "knöten")
    assert loadmat(run(odd, "mat", tmp_path / "a.mat"), simplify_cells=True)["events"]["text"] == TEXT
    assert open_run(odd).tree()["events"].to_dataset()["text"].item() == TEXT
    pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: `make parquet` installs it")
    run(odd, "parquet", tmp_path / "a.parquet")
    assert pd.read_parquet(tmp_path / "a.events.parquet")["text"].item() == TEXT
    assert list(pd.read_parquet(tmp_path / "a.parquet"))[3:] == ["Weg, oben", "time_1", "a#b", 'größe "µ"', "x" * 70]


@pytest.mark.parametrize("data", [EXTREME, EXTREME[:1]], ids=["extreme", "one sample"])
def test_extreme_numbers_come_back_bit_by_bit(data: Any, tmp_path: Path) -> None:
    bag = recording(tmp_path / "run", [block(0, data, RATE, START)])
    names = ["support_displacement", "beam_displacement"]
    table = pd.read_csv(run(bag, "csv", tmp_path / "a.csv"), comment="#", **EXACT).iloc[:, 3:].to_numpy()
    laser = loadmat(run(bag, "mat", tmp_path / "a.mat"), simplify_cells=True)["sensors_laser"]
    tree = open_run(bag).tree()["sensors/laser"].to_dataset()
    for found in (table, np.column_stack([np.atleast_1d(laser[n]) for n in names]), tree[names].to_array().values.T):
        np.testing.assert_array_equal(found, data)
        np.testing.assert_array_equal(np.signbit(found), np.signbit(data))
    records = [one for one in pyuff.UFF(run(bag, "uff", tmp_path / "a.uff")).read_sets() if one["type"] == 58]
    beam = np.concatenate([one["data"] for one in records if one["rsp_node"] == 2])
    np.testing.assert_array_equal(beam, data[:, 1])


def test_a_bag_without_messages_is_one_line_for_every_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = recording(tmp_path / "run", [])
    for form in ("csv", "mat", "uff"):
        assert main(["bag", "export", str(bag), "--format", form, "--out", str(tmp_path / f"a.{form}")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert [item.name for item in tmp_path.iterdir()] == ["run"]
