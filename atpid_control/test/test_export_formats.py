# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as files: CSV, UFF 58, MATLAB, Parquet and TDMS are read back by pandas, pyuff, scipy and npTDMS.

Bit by bit; UFF 58 in ASCII to the digits that it prints.
"""

import json
import sys
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyuff
from exported import BAG, EXACT, RATE, SLOW, START, expected, run, written
from scipy.io import loadmat

from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.runs.run import open_run
from atpid_control.runs.tables import Table
from atpid_control.views.export import uff_file
from atpid_control.views.export.uff_file import runs


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("exported") / "run")


def test_csv_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = run(bag, "csv", tmp_path / "run.csv")
    assert "missing: sensors/laser: 60 samples lost" in capsys.readouterr().out
    table = pd.read_csv(path, comment="#", **EXACT)
    assert list(table) == ["time [s]", "stamp [ns]", "index", "support_displacement [m]", "beam_displacement [m]"]
    for place, name in enumerate(("support_displacement [m]", "beam_displacement [m]")):
        np.testing.assert_array_equal(table[name], expected(place))
    np.testing.assert_array_equal(table["stamp [ns]"], START + np.arange(560) * 1_000_000)
    assert "# lost: 60 samples from index 200 on" in Path(path).read_text().splitlines()
    events = pd.read_csv(tmp_path / "run.events.csv", comment="#")
    assert events["text"].item() == '60 lost, "here" #1'
    assert {item.name for item in tmp_path.iterdir()} == {
        "run.csv", "run.events.csv", "run.excitation.csv", "run.sensors_force.csv", "run.sensors_force_blocks.csv",
        "run.sensors_laser_blocks.csv",
    }  # fmt: skip


def test_a_table_is_taken_in_place_of_the_bag_by_the_commands_that_take_tables(tmp_path: Path) -> None:
    path = Path(run(BAG, "csv", tmp_path / "run.csv", "--topic", "/sensors/laser"))
    table, bag = (signals_of(open_run(source))[0] for source in (path, BAG))
    assert table.rate == pytest.approx(bag.rate, rel=1e-12)
    assert (table.start, table.origin, bag.origin) == (bag.start, "table", "laser")
    np.testing.assert_array_equal(table.response, bag.response)
    np.testing.assert_array_equal(table.excitation, bag.excitation)


def test_matlab_is_read_back_by_scipy_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    found = loadmat(run(bag, "mat", tmp_path / "run.mat"), simplify_cells=True)
    laser = found["sensors_laser"]
    np.testing.assert_array_equal(laser["beam_displacement"], expected(1))
    np.testing.assert_array_equal(laser["stamp"], START + np.arange(560) * 1_000_000)
    assert laser["units"]["beam_displacement"] == "m"
    assert (laser["about_lost"], laser["about_gap_first_index"]) == (60, 200)
    assert found["sensors_force"]["about_rate"] == SLOW
    assert found["events"]["text"] == '60 lost, "here" #1'
    assert found["about"]["run_id"] == "numbers"


def test_uff_58_is_read_back_by_pyuff_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    sets = pyuff.UFF(run(bag, "uff", tmp_path / "run.uff")).read_sets()
    assert [one["type"] for one in sets] == [151, 164, *[58] * 6]
    records = [one for one in sets if one["type"] == 58]
    assert {one["func_type"] for one in records} == {1}
    support = [one for one in records if one["rsp_node"] == 1]
    beam = [one for one in records if one["rsp_node"] == 2]
    force = [one for one in records if one["rsp_node"] not in (1, 2)]
    assert ([len(one["data"]) for one in support], len(beam), len(force)) == ([200, 300], 3, 1)
    values = expected(1)
    for one, begin in zip(beam, (0, 58, 260), strict=True):
        np.testing.assert_array_equal(one["data"], values[begin : begin + len(one["data"])])
        assert one["abscissa_min"] == pytest.approx(begin / RATE, rel=1e-5)
        assert one["abscissa_inc"] == pytest.approx(1.0 / RATE)
        assert f"first index {begin}," in one["id4"]
        assert (one["ordinate_axis_units_lab"], one["ordinate_spec_data_type"], one["rsp_dir"]) == ("m", 8, 3)
    assert force[0]["ordinate_axis_units_lab"] == "N"


def test_uff_58_in_ascii_is_read_back_by_pyuff_to_its_digits(bag: Path, tmp_path: Path) -> None:
    """Half a unit of the 13th digit; all else is as in binary."""
    plain, binary = (run(bag, form, tmp_path / f"{form}.uff") for form in ("uff-ascii", "uff"))
    assert Path(plain).read_text(encoding="ascii").count("\n    58\n") == 6
    for one, other in zip(pyuff.UFF(plain).read_sets(), pyuff.UFF(binary).read_sets(), strict=True):
        if one["type"] == 58:
            np.testing.assert_allclose(one.pop("data"), other.pop("data"), rtol=5e-13, atol=0.0)
            assert (one.pop("binary"), other.pop("binary")) == (0, 1)
            same = one.keys() & other.keys() - {"byte_ordering", "fp_format", "n_ascii_lines", "n_bytes", "x"}
            assert {name: one[name] for name in same} == {name: other[name] for name in same}


def test_records_of_uff_58_do_not_add_up_all_gaps_anew(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else an export takes the square of the gaps: one a channel, and once for the line of what is missing."""
    added: list[str] = []

    def lost(table: Table) -> int:
        added.append(table.name)
        return sum(count for _, count in table.gaps)

    monkeypatch.setattr(Table, "lost", property(lost))
    run(bag, "uff", tmp_path / "run.uff")
    assert added.count("sensors/laser") <= 5


@pytest.mark.parametrize("count", [1, 4, 7])
def test_lines_of_ascii_have_four_numbers_of_twenty_columns(count: int) -> None:
    values = np.array([-1.0 / 3.0, 1e-300, -1e99, 0.0, 5e-99, 2.0, -7.0])[:count]
    lines = uff_file.digits(values).decode().split("\n")
    assert [len(line) for line in lines] == [80] * (count // 4) + [20 * (count % 4)] * (count % 4 > 0) + [0]
    text = "".join(lines)
    read = [float(text[place : place + 20]) for place in range(0, len(text), 20)]
    np.testing.assert_allclose(read, np.where(np.abs(values) < 1e-99, 0.0, values), rtol=5e-13)


def test_tdms_is_read_back_by_nptdms_bit_by_bit(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nptdms = pytest.importorskip("nptdms", reason="npTDMS is missing: `make import` installs it")
    path = run(bag, "tdms", tmp_path / "run.tdms")
    assert "not evenly sampled, so not in this format: sensors/laser_blocks" in capsys.readouterr().out
    with nptdms.TdmsFile.open(path) as file:
        assert [group.name for group in file.groups()] == ["sensors/laser", "sensors/force"]
        laser, beam = file["sensors/laser"], file["sensors/laser"]["beam_displacement"]
        np.testing.assert_array_equal(beam[:], expected(1))
        assert (beam.properties["unit_string"], beam.properties["wf_increment"]) == ("m", 1.0 / RATE)
        assert beam.properties["wf_start_time"] == np.datetime64(START, "ns")
        assert (laser.properties["lost"], file.properties["run_id"]) == (60, "numbers")
        assert "60 samples lost" in file.properties["missing"]
        assert file["sensors/force"]["force"].properties["skew"] == 1e-5


def test_tdms_comes_back_by_import(bag: Path, tmp_path: Path) -> None:
    pytest.importorskip("nptdms", reason="npTDMS is missing: `make import` installs it")
    path = run(bag, "tdms", tmp_path / "run.tdms")
    assert main(["bag", "import", path, "--out", str(tmp_path / "back")]) == 0
    one, other = (signals_of(open_run(source))[0] for source in (bag, tmp_path / "back"))
    assert (one.rate, one.start_ns) == (other.rate, other.start_ns)
    np.testing.assert_array_equal(one.response, other.response)


def test_parts_without_a_gap_across_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("atpid_control.views.export.uff_file._ROWS", 4)
    generator = np.random.default_rng(2)
    for _ in range(50):
        values = np.where(generator.random(17) < 0.3, np.nan, 1.0)
        valid = np.flatnonzero(np.isfinite(values))
        found = list(runs(values))
        assert [place for begin, end in found for place in range(begin, end)] == list(valid)
        assert all(begin < end for begin, end in found)
        assert all(end < following for (_, end), (following, _) in pairwise(found))


def test_parquet_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: `make parquet` installs it")
    path = run(bag, "parquet", tmp_path / "run.parquet")
    table = pd.read_parquet(path)
    np.testing.assert_array_equal(table["beam_displacement"], expected(1))
    np.testing.assert_array_equal(table["stamp"], START + np.arange(560) * 1_000_000)
    schema = parquet.read_schema(path)
    assert schema.field("beam_displacement").metadata[b"units"] == b"m"
    about = json.loads(parquet.read_metadata(path).metadata[b"atpid"])
    assert (about["lost"], about["run"]["run_id"]) == (60, "numbers")
    assert pd.read_parquet(tmp_path / "run.events.parquet")["text"].item() == '60 lost, "here" #1'


def test_a_part_and_one_topic(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = run(bag, "csv", tmp_path / "part.csv", "--topic", "/sensors/force", "--from", "0.1", "--to", "0.2")
    assert "part.csv: sensors/force, 33 rows" in capsys.readouterr().out
    table = pd.read_csv(path, comment="#", **EXACT)
    assert (table["index"].iloc[0], table["index"].iloc[-1]) == (32, 64)
    assert {item.name for item in tmp_path.iterdir()} == {"part.csv", "part.sensors_force_blocks.csv"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{tmp}/none", "--format", "csv", "--out", "{tmp}/a.csv"], "no such bag"),
        (["{tmp}", "--format", "csv", "--out", "{tmp}/a.csv"], "not a bag, there is no .mcap or .db3 file"),
        (["{bag}", "--format", "csv", "--out", "{tmp}/a.mat"], "allowed with --format csv: a file that ends in .csv"),
        (["{bag}", "--format", "uff", "--topic", "/events", "--out", "{tmp}/a.uff"], "there are no samples"),
        (["{bag}", "--format", "mat", "--topic", "/force", "--out", "{tmp}/a.mat"], "given /force; in the bag"),
        (["{bag}", "--format", "csv", "--from", "100", "--out", "{tmp}/a.csv"], "no row from 100"),
        (["{bag}", "--format", "mat", "--from", "100", "--out", "{tmp}/a.mat"], "no row from 100"),
        (["{bag}", "--format", "csv", "--out", "{tmp}/there.csv"], "exists already"),
        (["{bag}", "--format", "csv", "--out", "{tmp}/half.csv"], "half.events.csv: exists already"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_leaves_nothing(
    bag: Path, tmp_path: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("there.csv", "half.events.csv"):
        (tmp_path / name).write_text("mine")
    assert main(["bag", "export", *(text.format(bag=bag, tmp=tmp_path) for text in arguments)]) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert len(printed.err.splitlines()) == 1
    assert {item.name: item.read_text() for item in tmp_path.iterdir()} == {
        "there.csv": "mine", "half.events.csv": "mine",
    }  # fmt: skip


def test_without_pyarrow_one_line_says_what_to_install(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["bag", "export", str(bag), "--format", "parquet", "--out", str(tmp_path / "a.parquet")]) == 2
    assert "`make parquet` installs it" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def lengths(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A bag as long as the readers' buffers, and one three times as long."""
    folder = tmp_path_factory.mktemp("lengths")
    return [written(folder / f"run{blocks}", blocks, size=1000) for blocks in (40, 120)]


@pytest.mark.slow
@pytest.mark.parametrize(("form", "most"), [("csv", 0.5), ("uff", 0.5), ("tdms", 0.5), ("mat", 2.0)])
def test_memory_does_not_grow_with_the_length_of_the_bag(
    bag: Path, lengths: list[Path], tmp_path: Path, form: str, most: float
) -> None:
    """Of a bag three times as long at most `most` MB more: in MATLAB's format a column of 8 bytes a sample."""
    peaks = []
    main(["bag", "export", str(bag), "--format", form, "--out", str(tmp_path / f"first.{form}")])  # loads what it needs
    for longer in lengths:
        tracemalloc.start()
        main(["bag", "export", str(longer), "--format", form, "--out", str(tmp_path / f"{longer.name}.{form}")])
        peaks.append(tracemalloc.get_traced_memory()[1] * 1e-6)
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < most, peaks
