# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One Run: every reader of a recording sees the same samples, rate, instants and gaps, of any bag."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_files import BAG, RATE, START, jumps, rewritten, samples, with_topic
from recorded import LASER, Capture, begin_bag, block, refused, write_bag
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.cli import main
from atpid_control.runs import formats
from atpid_control.runs.check import check
from atpid_control.runs.decode import Converter
from atpid_control.runs.errors import BagError
from atpid_control.runs.playback import support_series
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import BEAM, SUPPORT, open_run
from atpid_control.runs.writer import Split
from atpid_sim.scene import scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.integration import drive_table, undamped_amplitude


def hardware(folder: Path, firsts: list[int], split: Split | None = None) -> Path:
    """Write a bag of the stand, without truth and scene: blocks of the laser that begin at these indices."""
    writer = begin_bag(folder, split=split)
    for number, first in enumerate(firsts):
        at = START + number * 50_000_000
        start = at - round(first / RATE * 1e9) if firsts[max(0, number - 1)] > first else START
        writer.write(LASER, block(first, samples(first + np.arange(50)), RATE, start), at, at)
    writer.close({"finished": "yes"})
    return folder


def in_sqlite(folder: Path, definitions: bool = True) -> Path:
    """Write the recorded bag as rosbag2 does in sqlite3; `definitions`: with those of its messages."""
    bag, store = open_bag(BAG), get_typestore(Stores.EMPTY)
    connections: dict[str, Any] = {}
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind in bag.types.items():
            known = get_types_from_msg(bag.decoder.definition(kind).decode(), kind)
            store.register({name: fields for name, fields in known.items() if name not in store.fielddefs})
            connections[topic] = writer.add_connection(topic, kind, typestore=store)
        installed = {kind: Converter(kind, bag.decoder) for kind in set(bag.types.values())}
        for raw in bag.raw:
            data = raw.data
            if not definitions:  # those installed are all that is known
                data = installed[bag.types[raw.topic]].convert(bag.decoder.decode(raw.schema, data))
            writer.write(connections[raw.topic], raw.log_ns, data)
    if not definitions:
        changed(folder, "DROP TABLE message_definitions")
    return folder


def changed(folder: Path, statement: str) -> None:
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as database:
        database.execute(statement)
        database.commit()


BAGS: dict[str, Callable[[Path], Path]] = {
    "whole": lambda _folder: BAG,
    "laser stuck": lambda _folder: BAG.with_name("laser_stuck"),
    "cut off": lambda _folder: BAG.with_name("cut_off"),
    "split": lambda folder: hardware(folder, list(range(0, 5000, 50)), Split(size=20_000)),
    "gap and restart": lambda folder: hardware(folder, [*range(0, 500, 50), *range(700, 2000, 50), *range(0, 600, 50)]),
    "jump": lambda folder: rewritten(folder, jumps(40, 2**40)),
    "foreign topics": with_topic,
    "sqlite3": in_sqlite,
    "sqlite3 without definitions": lambda folder: in_sqlite(folder, definitions=False),
}


def test_a_gap_is_nan_and_a_restart_another_stream_that_is_named(tmp_path: Path) -> None:
    run = open_run(BAGS["gap and restart"](tmp_path / "bag"))
    beam = run.signal(BEAM)
    assert (len(beam.values), beam.lost, int(np.isnan(beam.values).sum())) == (2000, 200, 200)
    assert np.isnan(beam.values[500:700]).all()
    (other,) = beam.others
    assert other.startswith("sensors/laser_2: 600 ")
    assert any({"1999", "0"} <= set(line.replace(",", "").split()) for line in run.missing)
    with pytest.raises(BagError, match=r"0\.5 s"):
        support_series(run)


@pytest.mark.parametrize("definitions", [True, False])
def test_a_bag_in_sqlite3_holds_what_the_other_does(definitions: bool, tmp_path: Path) -> None:
    ours, theirs = open_run(BAG), open_run(in_sqlite(tmp_path / "bag", definitions))
    assert ours.tables.keys() == theirs.tables.keys()
    for name, (_, arrays) in ours.tables.items():
        for column, values in arrays.items():
            np.testing.assert_array_equal(values, theirs.tables[name][1][column])
    assert theirs.missing == []
    assert check(theirs.path).findings == []


def test_a_type_without_a_definition_is_named(tmp_path: Path, capsys: Capture) -> None:
    folder = in_sqlite(tmp_path / "bag", definitions=False)
    changed(folder, "UPDATE topics SET type = 'lab/msg/Thing' WHERE name = '/ceiling/state'")
    (line,) = open_run(folder).missing
    assert "/ceiling/state: left out" in line
    changed(folder, "DROP TABLE messages")
    refused(capsys, ["bag", "check", folder], "topics", "messages", "rosbag2")


def test_origins_can_be_chosen_and_what_is_not_there_is_named() -> None:
    run = open_run(BAG)
    truth, laser = run.signal(BEAM, origin="truth"), run.signal(BEAM)
    assert (truth.origin, laser.origin, run.motion.origin, run.measured.origin) == ("truth", "laser", "truth", "laser")
    assert 1e-6 < np.abs(truth.values - laser.values).max() < 2e-4  # the laser's noise
    with pytest.raises(BagError, match=rf"{BEAM} .*accelerometer"):
        run.signal(BEAM, origin="accelerometer")
    with pytest.raises(BagError, match=rf"force; .*{BEAM}, {SUPPORT}"):
        run.signal("force")


def test_what_else_a_run_holds() -> None:
    run, bag = open_run(BAG), open_bag(BAG)
    heights = [message.height for _, message in bag.of_kind("CeilingCommand")]
    np.testing.assert_array_equal(run.commands.height, heights)
    np.testing.assert_array_equal(run.ceiling.height, [message.height for _, message in bag.of_kind("CeilingState")])
    np.testing.assert_array_equal(run.estimates.amplitude, [m.amplitude for _, m in bag.of_kind("Excitation")])
    assert [event.text for event in run.all_events] == [event.text for _, event in bag.of_kind("Event")]
    assert (run.scene is not None, run.scene_problem, run.scene_text) == (True, "", bag.scene_text)
    grain = np.concatenate([message.grain for _, message in bag.of_kind("PlantTruth")])
    np.testing.assert_array_equal(run.tree()["plant/truth"]["grain"], grain)
    assert run.tree().attrs["files"]["scene.yaml"] == bag.scene_text
    assert "identifier_node" in str(run.parameters["parameters"])
    assert (run.about, run.result) == (bag.run, bag.result)


def test_a_part_takes_its_samples_only_and_keeps_their_times() -> None:
    whole, part = open_run(BAG).signal(BEAM), open_run(BAG, begin=2.01, end=3.0).signal(BEAM)
    first = round(part.time0 * RATE)
    assert 1.9 < part.time0 <= 2.01
    assert len(part.values) < 1200
    np.testing.assert_array_equal(part.values, whole.values[first : first + len(part.values)])
    with pytest.raises(BagError, match=r"--from .*--to; .* 0 to 8 s"):
        open_run(BAG, begin=9.0).signal(BEAM)


# files of other programs


@pytest.mark.parametrize(
    ("points", "line"),
    [
        ([], r"run\.csv: .* package atpid_lab, which is not installed: .*`make setup`"),
        ([EntryPoint("vendor", "json:dumps", formats.GROUP)], r"vendor \(json:dumps\), .*: lacks name, suffixes"),
        ([EntryPoint("vendor", "atpid_control.runs.formats:Format", formats.GROUP)], "its name is"),
    ],
)
def test_a_format_that_is_not_installed_or_cannot_be_used_is_named(
    points: list[EntryPoint], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("atpid_common.entry_points.entry_points", lambda group: points)
    with pytest.raises(BagError, match=line):
        open_run(tmp_path / "run.csv")
    assert open_run(BAG).signal(BEAM).rate == RATE  # of a bag none is asked for


# the support's motion as a series


def scans(first: int, count: int = 50) -> Any:
    """Data (count, 2): the support is at 1 mm a scan."""
    return np.column_stack([1e-3 * np.arange(first, first + count), np.full(count, 9.0)])


def series_of(folder: Path, blocks: list[tuple[int, Any]], rates: tuple[float, ...] = (RATE,)) -> Path:
    """Write a bag with blocks (index of the first scan, data (n, 2)), which the recorder gets each 50 ms."""
    writer = begin_bag(folder)
    for number, (index, data) in enumerate(blocks):
        message = block(index, data, rates[number % len(rates)])
        writer.write(LASER, message, 50_000_000 * number, 50_000_000 * number)
    writer.close()
    return folder


def test_a_recorded_support_drives_a_simulation(tmp_path: Path, capsys: Capture) -> None:
    assert main(["bag", "extract", str(BAG), "--out", str(tmp_path), "--support"]) == 0
    assert "support.csv: 8000 " in capsys.readouterr().out
    recorded = read_yaml((open_bag(BAG).scene_text or ""), "bag")
    scene = recorded | {"duration": 7.9, "steady_window": [6.0, 7.9], "ceiling": {"height": 0.2}}
    measured = scene_from_mapping(scene | {"excitation": {"series": {"file": str(tmp_path / "support.csv")}}})
    tone = scene_from_mapping(scene)
    both = [undamped_amplitude(one, drive_table(one, one.steady_window)) for one in (measured, tone)]
    assert both[0] == pytest.approx(both[1], rel=1e-4)  # the laser's noise is 20 um


def test_times_are_index_over_rate(tmp_path: Path) -> None:
    bag = series_of(tmp_path / "bag", [(300, scans(0)), (350, np.zeros((0, 2))), (350, scans(50))])
    for (begin, end), index in (((0.0, 1.0), np.arange(100)), ((0.02, 0.06), np.arange(20, 61))):
        times, values = support_series(open_run(bag, begin=begin, end=end), begin, end)
        assert np.array_equal(times, index / RATE)
        assert np.array_equal(values, 1e-3 * index)


def test_what_is_missing_is_reported_and_can_be_left_out(tmp_path: Path) -> None:
    holed = scans(200)
    holed[7, 0] = np.nan
    laser = [(0, scans(0)), (50, scans(50)), (150, scans(150)), (200, holed), (0, scans(0))]
    bag = series_of(tmp_path / "bag", laser)
    for begin, end, line in (
        (0.0, 9.0, rf"{SUPPORT} .* 0\.1 s"),
        (0.15, 9.0, rf"{SUPPORT} .* 0\.207 s"),
        (0.0, 0.09, "anew"),
        (7.0, 8.0, r"--from .*--to; .* 0 to"),
    ):
        with pytest.raises(BagError, match=line):
            support_series(open_run(bag, begin=begin, end=end), begin, end)
    assert len(support_series(open_run(bag, begin=0.15, end=0.2), 0.15, 0.2)[0]) == 51
    changed = series_of(tmp_path / "rate", [(0, scans(0)), (50, scans(50))], rates=(RATE, 500.0))
    with pytest.raises(BagError, match="anew"):
        support_series(open_run(changed))


def test_a_bag_without_the_support_is_refused_with_what_it_has(tmp_path: Path, capsys: Capture) -> None:
    bag = write_bag(tmp_path / "bag", [(LASER, block(0, scans(0), channels=["acceleration", "temperature"]))])
    extract = ["bag", "extract", bag, "--out", tmp_path, "--support"]
    refused(capsys, extract, SUPPORT, "acceleration, temperature")


def test_nothing_is_written_over(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "support.csv").write_text("mine")
    (tmp_path / "file").write_text("")
    for folder in (tmp_path, tmp_path / "file" / "in"):
        refused(capsys, ["bag", "extract", BAG, "--out", folder, "--support", "1:2"])
    assert (tmp_path / "support.csv").read_text() == "mine"


@pytest.mark.parametrize("given", ["2", "3:2", "a:b", "-1:2", "nan:1", "1:2:3"])
def test_an_interval_that_is_none_is_refused_and_one_beside_another_command(given: str) -> None:
    assert main(["bag", "extract", "bag", f"--support={given}"]) == 2
    assert main(["bag", "check", "bag", "--support"]) == 2
