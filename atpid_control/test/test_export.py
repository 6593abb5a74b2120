# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as labelled arrays, xarray and pandas: what is in the bag, to the last digit, with units and hardware time."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from exported import BAG, LOST, RATE, SLOW, START, expected, samples, written
from recorded import block

from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.read import open_bag as messages_of
from atpid_control.runs.run import open_run
from atpid_control.runs.source import Source
from atpid_control.runs.writer import BagWriter


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("exported") / "run")


def test_samples_have_names_units_and_hardware_time(bag: Path) -> None:
    laser = open_run(bag).tree()["sensors/laser"].to_dataset()
    assert dict(laser.sizes) == {"time": 560}
    for place, name in enumerate(("support_displacement", "beam_displacement")):
        np.testing.assert_array_equal(laser[name], expected(place))
        assert laser[name].attrs["units"] == "m"
    np.testing.assert_array_equal(laser["index"], np.arange(560))
    np.testing.assert_array_equal(laser["stamp"], START + np.arange(560) * 1_000_000)
    np.testing.assert_allclose(laser["time"], np.arange(560) / RATE, rtol=0.0, atol=1e-12)
    assert (laser["time"].attrs["units"], laser["stamp"].attrs["units"]) == ("s", "ns")


def test_what_was_lost_is_counted_and_never_joined(bag: Path) -> None:
    tree = open_run(bag).tree()
    laser = tree["sensors/laser"].attrs
    assert (laser["lost"], laser["gap_first_index"], laser["gap_samples"]) == (LOST[1], [LOST[0]], [LOST[1]])
    assert tree.attrs["missing"] == ["sensors/laser: 60 samples lost in 1 gaps; their rows are NaN"]
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
    assert (event["text"].item(), event["node"].item()) == ('60 lost, "here" #1', "recorder_node")
    assert tree.attrs["run_id"] == "numbers"


def test_pandas_tables_have_the_time_as_index(bag: Path) -> None:
    laser = open_run(bag, ["/sensors/laser"]).frames()["sensors/laser"]
    np.testing.assert_array_equal(laser["beam_displacement"], expected(1))
    assert (laser.index.name, laser.attrs["units"]["beam_displacement"]) == ("time", "m")


def test_the_recorded_bag_is_what_its_messages_hold() -> None:
    tree, bag = open_run(BAG).tree(), messages_of(BAG)
    blocks = [message for _, message in bag.messages("/sensors/laser")]
    data = np.concatenate([np.reshape(message.data, (-1, 2)) for message in blocks])
    laser = tree["sensors/laser"]
    np.testing.assert_array_equal(laser["beam_displacement"], data[:, 1])
    for name, topic in (("plant/truth", "/plant/truth"), ("excitation", "/excitation")):
        read = [message for _, message in bag.messages(topic)]
        column = "grain" if name == "plant/truth" else "amplitude"
        values = np.concatenate([np.atleast_1d(getattr(message, column)) for message in read])
        np.testing.assert_array_equal(tree[name][column], values)
    assert tree.attrs["files"]["scene.yaml"] == bag.scene_text


def test_a_dataset_survives_a_round_trip_through_pandas(bag: Path) -> None:
    laser = open_run(bag).tree()["sensors/laser"].to_dataset()
    again = xr.Dataset.from_dataframe(laser.to_dataframe())
    np.testing.assert_array_equal(again["beam_displacement"], laser["beam_displacement"])


def test_a_stream_that_starts_anew_is_a_table_of_its_own_and_what_goes_back_is_left_out(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", new_run(run_id="anew", commit="none"))
    writer.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    for number, first in enumerate((0, 50, 50, 100, 0, 50)):
        at = START + number * 50_000_000
        writer.write("/sensors/laser", block(first, samples(first + np.arange(50)), RATE, START), at, at)
    writer.close({"finished": "yes"})
    tree = open_run(tmp_path / "run").tree()
    assert tree["sensors/laser"].sizes["time"] == 150
    assert tree["sensors/laser_2"].sizes["time"] == 100
    assert "sensors/laser: 1 messages left out: a block goes back to index 50 after 99" in tree.attrs["missing"]


def test_a_topic_that_is_not_there(bag: Path) -> None:
    with pytest.raises(BagError, match="given /none; in the bag: /events, /excitation"):
        open_run(bag, ["/none"]).tree()


def test_the_pass_over_a_bag_can_be_used_alone(bag: Path) -> None:
    source = Source(bag)
    rows = {table.name: 0 for table in source.tables}
    for piece in source.pieces():
        rows[piece.table.name] = rows.get(piece.table.name, 0) + len(piece)
    assert rows["sensors/laser"] == 560
    assert {table.name: table.rows for table in source.tables} == rows


def test_a_counter_started_anew_whose_first_blocks_are_lost_is_a_table_of_its_own(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", new_run(run_id="anew", commit="none"))
    writer.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    for first, start in ((0, START), (50, START), (7, START + 10**9), (57, START + 10**9)):
        at = start + first * 1_000_000
        writer.write("/sensors/laser", block(first, samples(first + np.arange(50)), RATE, start), at, at)
    writer.close({"finished": "yes"})
    tree = open_run(tmp_path / "run").tree()
    np.testing.assert_array_equal(tree["sensors/laser"].to_dataset()["index"], np.arange(100))
    again = tree["sensors/laser_2"].to_dataset()
    np.testing.assert_array_equal(again["index"], np.arange(7, 107))
    np.testing.assert_array_equal(again["stamp"], START + 10**9 + np.arange(7, 107) * 1_000_000)
    np.testing.assert_array_equal(again["beam_displacement"], samples(np.arange(7, 107))[:, 1])
    assert tree.attrs["missing"] == ["sensors/laser_2: a table of its own: its index goes from 99 to 7, at 1000 Hz"]


def test_a_bag_without_a_message_that_can_be_used_states_why(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", new_run(run_id="none", commit="none"))
    writer.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    writer.write("/sensors/laser", block(0, np.full((5, 2), np.inf), RATE, START), START, START)
    writer.close({"finished": "yes"})
    with pytest.raises(BagError, match=r"no message in this bag can be used; .*1 messages left out: a value is above"):
        open_run(tmp_path / "run").tree()
