# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as arrays and files, read back by xarray, pandas, pyuff, scipy and npTDMS: to the last digit, with units."""

import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import pyuff
import xarray as xr
from bag_files import BAG, BEAM, EXACT, RATE, SLOW, START, SUPPORT, TEXT, expected, exported, samples, written
from recorded import EVENTS, LASER, Capture, begin_bag, block, make, peak_of, refused, write_bag
from scipy.io import loadmat

from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.runs.errors import BagError
from atpid_control.runs.run import open_run
from atpid_lab.export.uff_file import digits, runs

NAMES = ["Weg, oben", "time", "a#b", 'größe "µ"', "x" * 70]
SHOWN = ["Weg, oben", "time_1", "a#b", 'größe "µ"', "x" * 70]
UNITS = ["mm", "", "m/s²", "V", "N"]
ANY_SCRIPT = 'Größe µ "x", #1\nzweite Zeile\r\n日本語 ☃ \t;'
EXTREME = np.array([[5e-324, -0.0], [1e11, -1e11], [np.nan, np.nextafter(1.0, 2.0)], [0.1 + 0.2, 1.0 / 3.0]])


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("exported") / "run")


def test_samples_have_names_units_and_hardware_time(bag: Path) -> None:
    laser = open_run(bag).tree()["sensors/laser"].to_dataset()
    assert dict(laser.sizes) == {"time": 560}
    for place, name in enumerate((SUPPORT, BEAM)):
        np.testing.assert_array_equal(laser[name], expected(place))
        assert laser[name].attrs["units"] == "m"
    np.testing.assert_array_equal(laser["index"], np.arange(560))
    np.testing.assert_array_equal(laser["stamp"], START + np.arange(560) * 1_000_000)
    np.testing.assert_allclose(laser["time"], np.arange(560) / RATE, rtol=0.0, atol=1e-12)
    assert (laser["time"].attrs["units"], laser["stamp"].attrs["units"]) == ("s", "ns")
    again = xr.Dataset.from_dataframe(laser.to_dataframe())
    np.testing.assert_array_equal(again[BEAM], laser[BEAM])


def test_other_rates_and_topics_are_datasets_of_their_own(bag: Path) -> None:
    tree = open_run(bag).tree()
    assert {node.path for node in tree.leaves} == {
        "/sensors/laser", "/sensors/laser_blocks", "/sensors/force", "/sensors/force_blocks", "/excitation", "/events",
    }  # fmt: skip
    force, estimates, event = (tree[name].to_dataset() for name in ("sensors/force", "excitation", "events"))
    assert (force.attrs["rate"], force.sizes["time"], force["force"].attrs["skew"]) == (SLOW, 160, 1e-5)
    assert force["force"].attrs["units"] == "N"
    np.testing.assert_array_equal(estimates["used"], np.arange(10))
    assert estimates["frequency"].attrs["units"] == "Hz"
    assert float(estimates["amplitude"][3]) == 0.01 / 3.0
    np.testing.assert_allclose(estimates["received"] - estimates["time"], 0.003 - 2e-9, atol=1e-9)
    assert (event["text"].item(), event["node"].item()) == (TEXT, "recorder_node")
    assert tree.attrs["run_id"] == "numbers"


def test_a_stream_that_starts_anew_is_a_table_of_its_own_and_what_goes_back_is_left_out(tmp_path: Path) -> None:
    def tree_of(name: str, blocks: list[tuple[int, int]]) -> Any:
        writer = begin_bag(tmp_path / name)
        for number, (first, start) in enumerate(blocks):
            at = START + number * 50_000_000
            writer.write(LASER, block(first, samples(first + np.arange(50)), RATE, start), at, at)
        writer.close({"finished": "yes"})
        return open_run(tmp_path / name).tree()

    tree = tree_of("back", [(first, START) for first in (0, 50, 50, 100, 0, 50)])
    assert [tree[f"sensors/{name}"].sizes["time"] for name in ("laser", "laser_2")] == [150, 100]
    (line,) = (line for line in tree.attrs["missing"] if line.startswith("sensors/laser: 1 "))
    assert line.endswith(" 50 after 99")
    later = START + 10**9
    tree = tree_of("anew", [(0, START), (50, START), (7, later), (57, later)])  # its first blocks are lost
    np.testing.assert_array_equal(tree["sensors/laser"].to_dataset()["index"], np.arange(100))
    again, index = tree["sensors/laser_2"].to_dataset(), np.arange(7, 107)
    np.testing.assert_array_equal(again["index"], index)
    np.testing.assert_array_equal(again["stamp"], later + index * 1_000_000)
    np.testing.assert_array_equal(again[BEAM], samples(index)[:, 1])
    (line,) = tree.attrs["missing"]
    assert line.startswith("sensors/laser_2: ")
    assert line.endswith(" 99 to 7, at 1000 Hz")


def test_a_bag_without_a_message_that_can_be_used_states_why(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", [(LASER, block(0, np.full((5, 2), np.inf), RATE, START))])
    with pytest.raises(BagError, match=r"run: .* 1 .*above"):
        open_run(bag).tree()


# what is unusual: names, one sample, extreme numbers, texts in any script


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    named = block(0, samples(np.arange(50), 5), RATE, START, channels=NAMES, units=UNITS, skew=np.zeros(5))
    event = make("Event", START, "knöten", kind="note", value=1.0, text=ANY_SCRIPT)
    return write_bag(tmp_path_factory.mktemp("odd") / "run", [(LASER, named), (EVENTS, event)], topics=(LASER, EVENTS))


def test_csv_keeps_names_that_hold_signs_of_its_own(odd: Path, tmp_path: Path) -> None:
    table = pd.read_csv(exported(odd, "csv", tmp_path / "a.csv"), comment="#", **EXACT)
    shown = [f"{name} [{unit}]" if unit else name for name, unit in zip(SHOWN, UNITS, strict=True)]
    assert list(table)[3:] == shown
    np.testing.assert_array_equal(table[shown], samples(np.arange(50), 5))
    np.testing.assert_array_equal(table["index"], np.arange(50))
    events = pd.read_csv(tmp_path / "a.events.csv", comment="#", lineterminator="\n", keep_default_na=False)
    assert (events["text"].item(), events["node"].item()) == (ANY_SCRIPT, "knöten")


def test_matlab_has_names_it_takes_and_those_of_the_bag(odd: Path, tmp_path: Path) -> None:
    found = loadmat(exported(odd, "mat", tmp_path / "a.mat"), simplify_cells=True)
    laser = found["sensors_laser"]
    fields = [name for name in laser if name in laser["names"]][3:]
    assert [laser["names"][name] for name in fields] == SHOWN
    assert all(name.isascii() and name.isidentifier() and len(name) < 64 for name in fields)
    np.testing.assert_array_equal(np.column_stack([laser[name] for name in fields]), samples(np.arange(50), 5))
    assert found["events"]["text"] == ANY_SCRIPT


def test_uff_has_lines_of_80_signs_and_double_values(odd: Path, tmp_path: Path) -> None:
    path = exported(odd, "uff", tmp_path / "a.uff")
    records = [one for one in pyuff.UFF(str(path)).read_sets() if one["type"] == 58]
    np.testing.assert_array_equal(np.column_stack([one["data"] for one in records]), samples(np.arange(50), 5))
    assert [one["ordinate_axis_units_lab"] for one in records] == ["mm", "NONE", "m/s?", "V", "N"]
    for part in path.read_bytes().split(b"\n    58b")[1:]:
        assert all(len(line) <= 80 for line in part.split(b"\n")[:12])


def test_a_text_in_any_script_comes_back(odd: Path, tmp_path: Path) -> None:
    assert open_run(odd).tree()["events"].to_dataset()["text"].item() == ANY_SCRIPT
    pytest.importorskip("pyarrow.parquet", reason="pyarrow is missing: `make parquet` installs it")
    exported(odd, "parquet", tmp_path / "a.parquet")
    assert pd.read_parquet(tmp_path / "a.events.parquet")["text"].item() == ANY_SCRIPT
    assert list(pd.read_parquet(tmp_path / "a.parquet"))[3:] == SHOWN


@pytest.mark.parametrize("data", [EXTREME, EXTREME[:1]], ids=["extreme", "one sample"])
def test_extreme_numbers_come_back_bit_by_bit(data: Any, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", [(LASER, block(0, data, RATE, START))])
    table = pd.read_csv(exported(bag, "csv", tmp_path / "a.csv"), comment="#", **EXACT).iloc[:, 3:].to_numpy()
    laser = loadmat(exported(bag, "mat", tmp_path / "a.mat"), simplify_cells=True)["sensors_laser"]
    matlab = np.column_stack([np.atleast_1d(laser[name]) for name in (SUPPORT, BEAM)])
    tree = open_run(bag).tree()["sensors/laser"].to_dataset()[[SUPPORT, BEAM]].to_array().values.T
    for found in (table, matlab, tree):
        np.testing.assert_array_equal(found, data)
        np.testing.assert_array_equal(np.signbit(found), np.signbit(data))
    records = pyuff.UFF(str(exported(bag, "uff", tmp_path / "a.uff"))).read_sets()
    beam = np.concatenate([one["data"] for one in records if one["type"] == 58 and one["rsp_node"] == 2])
    np.testing.assert_array_equal(beam, data[:, 1])


STAMPS = START + np.arange(560) * 1_000_000


def test_csv_is_read_back_by_pandas_bit_by_bit(bag: Path, tmp_path: Path, capsys: Capture) -> None:
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


@pytest.mark.parametrize("count", [1, 4, 7])
def test_lines_of_ascii_have_four_numbers_of_twenty_columns(count: int) -> None:
    values = np.array([-1.0 / 3.0, 1e-300, -1e99, 0.0, 5e-99, 2.0, -7.0])[:count]
    text = digits(values).decode()
    assert max(map(len, text.split("\n"))) == 20 * min(count, 4)
    text = text.replace("\n", "")
    read = [float(text[place : place + 20]) for place in range(0, len(text), 20)]
    np.testing.assert_allclose(read, np.where(np.abs(values) < 1e-99, 0.0, values), rtol=5e-13)


def test_parts_without_a_gap_across_pieces() -> None:
    """A series of some pieces, each of which is 16 384 values long."""
    generator = np.random.default_rng(2)
    for share in (0.3, 0.1, 1e-4, 0.0):
        values = np.where(generator.random(50_000) < share, np.nan, 1.0)
        edges = np.flatnonzero(np.diff(np.isfinite(values), prepend=False, append=False))
        np.testing.assert_array_equal(list(runs(values)), edges.reshape(-1, 2))


def test_tdms_is_read_back_by_nptdms_and_by_import_bit_by_bit(bag: Path, tmp_path: Path, capsys: Capture) -> None:
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


def test_a_part_and_one_topic(bag: Path, tmp_path: Path, capsys: Capture) -> None:
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
    capsys: Capture, monkeypatch: pytest.MonkeyPatch,
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
    """Of a bag as long as the readers' buffers, and one twice as long, which takes at most `most` MB more."""
    if form == "tdms":
        pytest.importorskip("nptdms", reason="npTDMS or h5py is missing: `make import` installs it")
    exported(bag, form, tmp_path / f"first.{form}")  # loads what it needs
    short, long = (written(tmp_path / f"run{count}", count, size=1000) for count in blocks)
    least = peak_of(partial(exported, short, form, tmp_path / f"short.{form}"))
    # cycles that hold arrays are collected at any time: what grows grows in each of these
    more = (peak_of(partial(exported, long, form, tmp_path / f"{count}.{form}")) - least for count in range(5))
    assert any(1e-6 * grown < most for grown in more)
