# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as files: CSV, UFF 58, MATLAB, Parquet and TDMS are read back by pandas, pyuff, scipy and npTDMS, bit by bit.

UFF 58 in ASCII to the digits that it prints.
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
from bag_files import BAG, BEAM, EXACT, RATE, SLOW, START, SUPPORT, TEXT, expected, exported, written
from recorded import refused
from scipy.io import loadmat

from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.runs.run import open_run
from atpid_control.runs.tables import Table
from atpid_control.views.export.uff_file import digits, runs

STAMPS = START + np.arange(560) * 1_000_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("exported") / "run")


def test_csv_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exported(bag, "csv", tmp_path / "run.csv")
    assert "missing: sensors/laser: 60 " in capsys.readouterr().out
    table = pd.read_csv(path, comment="#", **EXACT)
    assert list(table) == ["time [s]", "stamp [ns]", "index", f"{SUPPORT} [m]", f"{BEAM} [m]"]
    for place, name in enumerate((SUPPORT, BEAM)):
        np.testing.assert_array_equal(table[f"{name} [m]"], expected(place))
    np.testing.assert_array_equal(table["stamp [ns]"], STAMPS)
    (line,) = (line for line in path.read_text().splitlines() if line.startswith("# lost: "))
    assert {"60", "200"} <= set(line.split())
    assert pd.read_csv(tmp_path / "run.events.csv", comment="#")["text"].item() == TEXT
    assert {item.name for item in tmp_path.iterdir()} == {
        "run.csv", "run.events.csv", "run.excitation.csv", "run.sensors_force.csv", "run.sensors_force_blocks.csv",
        "run.sensors_laser_blocks.csv",
    }  # fmt: skip


def test_a_table_is_taken_in_place_of_the_bag_by_the_commands_that_take_tables(tmp_path: Path) -> None:
    path = exported(BAG, "csv", tmp_path / "run.csv", "--topic", "/sensors/laser")
    table, bag = (signals_of(open_run(source))[0] for source in (path, BAG))
    assert table.rate == pytest.approx(bag.rate, rel=1e-12)
    assert (table.start, table.origin, bag.origin) == (bag.start, "table", "laser")
    np.testing.assert_array_equal(table.response, bag.response)
    np.testing.assert_array_equal(table.excitation, bag.excitation)


def test_matlab_is_read_back_by_scipy_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    found = loadmat(exported(bag, "mat", tmp_path / "run.mat"), simplify_cells=True)
    laser = found["sensors_laser"]
    np.testing.assert_array_equal(laser[BEAM], expected(1))
    np.testing.assert_array_equal(laser["stamp"], STAMPS)
    assert laser["units"][BEAM] == "m"
    assert (laser["about_lost"], laser["about_gap_first_index"]) == (60, 200)
    assert found["sensors_force"]["about_rate"] == SLOW
    assert (found["events"]["text"], found["about"]["run_id"]) == (TEXT, "numbers")


def test_uff_58_is_read_back_by_pyuff_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    sets = pyuff.UFF(str(exported(bag, "uff", tmp_path / "run.uff"))).read_sets()
    assert [one["type"] for one in sets] == [151, 164, *[58] * 6]
    records = sets[2:]
    assert {one["func_type"] for one in records} == {1}
    support, beam = ([one for one in records if one["rsp_node"] == node] for node in (1, 2))
    (force,) = (one for one in records if one["rsp_node"] not in (1, 2))
    assert [len(one["data"]) for one in support] == [200, 300]
    values = expected(1)
    for one, begin in zip(beam, (0, 58, 260), strict=True):
        np.testing.assert_array_equal(one["data"], values[begin : begin + len(one["data"])])
        assert one["abscissa_min"] == pytest.approx(begin / RATE, rel=1e-5)
        assert one["abscissa_inc"] == pytest.approx(1.0 / RATE)
        assert f" {begin}," in one["id4"]
        assert (one["ordinate_axis_units_lab"], one["ordinate_spec_data_type"], one["rsp_dir"]) == ("m", 8, 3)
    assert force["ordinate_axis_units_lab"] == "N"


def test_uff_58_in_ascii_is_read_back_by_pyuff_to_its_digits(bag: Path, tmp_path: Path) -> None:
    """Half a unit of the 13th digit; all else is as in binary."""
    plain, binary = (exported(bag, form, tmp_path / f"{form}.uff") for form in ("uff-ascii", "uff"))
    assert plain.read_text(encoding="ascii").count("\n    58\n") == 6
    sets, others = (pyuff.UFF(str(path)).read_sets()[2:] for path in (plain, binary))
    for one, other in zip(sets, others, strict=True):
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
    exported(bag, "uff", tmp_path / "run.uff")
    assert added.count("sensors/laser") <= 5


@pytest.mark.parametrize("count", [1, 4, 7])
def test_lines_of_ascii_have_four_numbers_of_twenty_columns(count: int) -> None:
    values = np.array([-1.0 / 3.0, 1e-300, -1e99, 0.0, 5e-99, 2.0, -7.0])[:count]
    lines = digits(values).decode().split("\n")
    assert [len(line) for line in lines] == [80] * (count // 4) + [20 * (count % 4)] * (count % 4 > 0) + [0]
    text = "".join(lines)
    read = [float(text[place : place + 20]) for place in range(0, len(text), 20)]
    np.testing.assert_allclose(read, np.where(np.abs(values) < 1e-99, 0.0, values), rtol=5e-13)


def test_parts_without_a_gap_across_pieces() -> None:
    """A series of some pieces, each of which is 16 384 values long."""
    generator = np.random.default_rng(2)
    for share in (0.3, 0.1, 1e-4, 0.0):
        values = np.where(generator.random(50_000) < share, np.nan, 1.0)
        valid = np.isfinite(values)
        found = list(runs(values))
        covered = np.zeros(len(values), bool)
        for begin, end in found:
            assert begin < end
            covered[begin:end] = True
        np.testing.assert_array_equal(covered, valid)
        assert all(end < following for (_, end), (following, _) in pairwise(found))


def test_tdms_is_read_back_by_nptdms_and_by_import_bit_by_bit(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nptdms = pytest.importorskip("nptdms", reason="npTDMS or h5py is missing: `make import` installs it")
    path = exported(bag, "tdms", tmp_path / "run.tdms")
    assert ": sensors/laser_blocks" in capsys.readouterr().out
    with nptdms.TdmsFile.open(path) as file:
        assert [group.name for group in file.groups()] == ["sensors/laser", "sensors/force"]
        laser, beam = file["sensors/laser"], file["sensors/laser"][BEAM]
        np.testing.assert_array_equal(beam[:], expected(1))
        assert (beam.properties["unit_string"], beam.properties["wf_increment"]) == ("m", 1.0 / RATE)
        assert beam.properties["wf_start_time"] == np.datetime64(START, "ns")
        assert (laser.properties["lost"], file.properties["run_id"]) == (60, "numbers")
        assert "sensors/laser: 60 " in file.properties["missing"]
        assert file["sensors/force"]["force"].properties["skew"] == 1e-5
    assert main(["bag", "import", str(path), "--out", str(tmp_path / "back")]) == 0
    one, other = (signals_of(open_run(source))[0] for source in (bag, tmp_path / "back"))
    assert (one.rate, one.start_ns) == (other.rate, other.start_ns)
    np.testing.assert_array_equal(one.response, other.response)


def test_parquet_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: `make parquet` installs it")
    path = exported(bag, "parquet", tmp_path / "run.parquet")
    table = pd.read_parquet(path)
    np.testing.assert_array_equal(table[BEAM], expected(1))
    np.testing.assert_array_equal(table["stamp"], STAMPS)
    assert parquet.read_schema(path).field(BEAM).metadata[b"units"] == b"m"
    about = json.loads(parquet.read_metadata(path).metadata[b"atpid"])
    assert (about["lost"], about["run"]["run_id"]) == (60, "numbers")
    assert pd.read_parquet(tmp_path / "run.events.parquet")["text"].item() == TEXT


def test_a_part_and_one_topic(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exported(bag, "csv", tmp_path / "part.csv", "--topic", "/sensors/force", "--from", "0.1", "--to", "0.2")
    assert "part.csv: sensors/force, 33 " in capsys.readouterr().out
    table = pd.read_csv(path, comment="#", **EXACT)
    assert (table["index"].iloc[0], table["index"].iloc[-1]) == (32, 64)
    assert {item.name for item in tmp_path.iterdir()} == {"part.csv", "part.sensors_force_blocks.csv"}


@pytest.mark.parametrize(
    ("source", "form", "out", "more", "parts"),
    [
        ("{tmp}/none", "csv", "a.csv", [], ["/none"]),
        ("{tmp}", "csv", "a.csv", [], [".mcap", ".db3"]),
        ("{bag}", "csv", "a.mat", [], ["--format csv", ".csv"]),
        ("{bag}", "uff", "a.uff", ["--topic", "/events"], ["no samples"]),
        ("{bag}", "mat", "a.mat", ["--topic", "/force"], ["/force; ", "/sensors/force"]),
        ("{bag}", "csv", "a.csv", ["--from", "100"], [" 100"]),
        ("{bag}", "mat", "a.mat", ["--from", "100"], [" 100"]),
        ("{bag}", "csv", "there.csv", [], ["there.csv: exists"]),
        ("{bag}", "csv", "half.csv", [], ["half.events.csv: exists"]),
        ("{bag}", "parquet", "a.parquet", [], ["`make parquet`"]),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    source: str, form: str, out: str, more: list[str], parts: list[str], bag: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    mine = {"there.csv": "mine", "half.events.csv": "mine"}
    for name, text in mine.items():
        (tmp_path / name).write_text(text)
    path = source.format(bag=bag, tmp=tmp_path)
    refused(capsys, ["bag", "export", path, "--format", form, *more, "--out", tmp_path / out], *parts)
    assert {item.name: item.read_text() for item in tmp_path.iterdir()} == mine


@pytest.mark.parametrize(
    ("form", "blocks", "most"),
    [("csv", (20, 40), 0.15), ("uff", (40, 80), 0.15), ("tdms", (40, 80), 0.15), ("mat", (40, 80), 1.0)],
)
def test_memory_does_not_grow_with_the_length_of_the_bag(
    bag: Path, form: str, blocks: tuple[int, int], most: float, tmp_path: Path
) -> None:
    """Of a bag as long as the readers' buffers, and one twice as long, which takes at most `most` MB more.

    In MATLAB's format a column of 8 bytes a sample.
    """
    if form == "tdms":
        pytest.importorskip("nptdms", reason="npTDMS or h5py is missing: `make import` installs it")
    exported(bag, form, tmp_path / f"first.{form}")  # loads what it needs
    peaks = []
    for count in blocks:
        longer = written(tmp_path / f"run{count}", count, size=1000)
        tracemalloc.start()
        exported(longer, form, tmp_path / f"{count}.{form}")
        peaks.append(tracemalloc.get_traced_memory()[1] * 1e-6)
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < most, peaks
