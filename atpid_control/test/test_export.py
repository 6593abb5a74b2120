# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as labelled arrays, xarray and pandas, and exports of what is unusual: to the last digit, with units."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import pyuff
import xarray as xr
from bag_files import BEAM, EXACT, LOST, RATE, SLOW, START, SUPPORT, TEXT, expected, exported, samples, written
from recorded import EVENTS, LASER, begin_bag, block, make, refused, write_bag
from scipy.io import loadmat

from atpid_control.runs.errors import BagError
from atpid_control.runs.run import open_run

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


def test_what_was_lost_is_counted_and_never_joined(bag: Path) -> None:
    tree = open_run(bag).tree()
    laser = tree["sensors/laser"].attrs
    assert (laser["lost"], laser["gap_first_index"], laser["gap_samples"]) == (LOST[1], [LOST[0]], [LOST[1]])
    (line,) = tree.attrs["missing"]
    assert line.startswith("sensors/laser: 60 ")
    assert tree["sensors/force"].attrs["lost"] == 0


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


def test_pandas_tables_have_the_time_as_index(bag: Path) -> None:
    laser = open_run(bag, [LASER]).frames()["sensors/laser"]
    np.testing.assert_array_equal(laser[BEAM], expected(1))
    assert (laser.index.name, laser.attrs["units"][BEAM]) == ("time", "m")


def test_a_stream_that_starts_anew_is_a_table_of_its_own_and_what_goes_back_is_left_out(tmp_path: Path) -> None:
    writer = begin_bag(tmp_path / "run")
    for number, first in enumerate((0, 50, 50, 100, 0, 50)):
        at = START + number * 50_000_000
        writer.write(LASER, block(first, samples(first + np.arange(50)), RATE, START), at, at)
    writer.close({"finished": "yes"})
    tree = open_run(tmp_path / "run").tree()
    assert tree["sensors/laser"].sizes["time"] == 150
    assert tree["sensors/laser_2"].sizes["time"] == 100
    (line,) = (line for line in tree.attrs["missing"] if line.startswith("sensors/laser: 1 "))
    assert line.endswith(" 50 after 99")


def test_a_counter_started_anew_whose_first_blocks_are_lost_is_a_table_of_its_own(tmp_path: Path) -> None:
    later = START + 10**9
    blocks = [
        (LASER, block(first, samples(first + np.arange(50)), RATE, start))
        for first, start in ((0, START), (50, START), (7, later), (57, later))
    ]
    tree = open_run(write_bag(tmp_path / "run", blocks)).tree()
    np.testing.assert_array_equal(tree["sensors/laser"].to_dataset()["index"], np.arange(100))
    again, index = tree["sensors/laser_2"].to_dataset(), np.arange(7, 107)
    np.testing.assert_array_equal(again["index"], index)
    np.testing.assert_array_equal(again["stamp"], later + index * 1_000_000)
    np.testing.assert_array_equal(again[BEAM], samples(index)[:, 1])
    (line,) = tree.attrs["missing"]
    assert line.startswith("sensors/laser_2: ")
    assert line.endswith(" 99 to 7, at 1000 Hz")


def test_a_topic_that_is_not_there(bag: Path) -> None:
    with pytest.raises(BagError, match=r"/none; .*/events, /excitation"):
        open_run(bag, ["/none"]).tree()


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


def test_a_bag_without_messages_is_one_line_for_every_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "run")
    for form in ("csv", "mat", "uff"):
        refused(capsys, ["bag", "export", bag, "--format", form, "--out", tmp_path / f"a.{form}"])
    assert [item.name for item in tmp_path.iterdir()] == ["run"]
