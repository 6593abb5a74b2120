# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One Run: every reader of a recording sees the same samples, rate, instants and gaps, of any bag."""

import argparse
import sqlite3
from collections.abc import Callable
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from exported import BAG, EXACT, ROOT, START, samples
from exported import run as exported
from recorded import block
from rewritten import jumps, rewritten
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from test_export_foreign import OWN, with_topic

from atpid_control.analysis.analyse import analyse
from atpid_control.analysis.signals import Signals, signals_of
from atpid_control.analysis.validation.measured import read_measured
from atpid_control.cli import main
from atpid_control.commands import calibrate_beam
from atpid_control.runs.check import check
from atpid_control.runs.decode import Converter
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import BEAM, SUPPORT, open_run
from atpid_control.runs.support import support_series
from atpid_control.runs.writer import BagWriter, Split
from atpid_control.views.comparison import compare
from atpid_control.views.report.page import analysis_of
from atpid_control.views.report.view import view_of

RATE = 1000.0
LASER = "/sensors/laser"


def hardware(folder: Path, firsts: list[int], split: Split | None = None) -> Path:
    """Write a bag of the stand, without truth and scene: blocks of the laser that begin at these indices."""
    writer = BagWriter(folder, new_run(run_id="stand", commit="none"), split=split)
    writer.add_topic(LASER, "atpid_interfaces/msg/SampleBlock")
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
        with closing(sqlite3.connect(next(folder.glob("*.db3")))) as database:
            database.execute("DROP TABLE message_definitions")
            database.commit()
    return folder


def foreign(folder: Path) -> Path:
    return with_topic(folder, "cdr", "ros2msg", OWN, b"\0\1\0\0" + bytes(12))


BAGS: dict[str, Callable[[Path], Path]] = {
    **{name: lambda _folder, name=name: ROOT / "bags" / name  # type: ignore[misc]
       for name in ("thesis_4_3_short", "rumble", "laser_stuck", "cut_off")},
    "split": lambda folder: hardware(folder, list(range(0, 5000, 50)), Split(size=20_000)),
    "gap and restart": lambda folder: hardware(folder, [*range(0, 500, 50), *range(700, 2000, 50), *range(0, 600, 50)]),
    "jump": lambda folder: rewritten(folder, jumps(40, 2**40)),
    "foreign topics": foreign,
    "sqlite3": in_sqlite,
    "sqlite3 without definitions": lambda folder: in_sqlite(folder, definitions=False),
    "hardware": lambda folder: hardware(folder, list(range(0, 3000, 50))),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAGS))
def test_every_reader_sees_the_same(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = BAGS[name](tmp_path / "bag")
    run = open_run(bag)
    support, beam = run.signals(SUPPORT, BEAM)
    assert (beam.rate, beam.origin) == (RATE, "laser")  # as the messages state it, not by their stamps

    def agrees(signals: Signals) -> None:
        np.testing.assert_array_equal(signals.response, beam.values)
        np.testing.assert_array_equal(signals.excitation, support.values)
        assert (signals.rate, signals.start, signals.start_ns) == (beam.rate, beam.time0, beam.start_ns)
        np.testing.assert_array_equal(signals.time, beam.time)

    signals, missing = signals_of(run)
    agrees(signals)
    assert set(run.missing) <= set(missing)

    monkeypatch.setattr(
        import_module("atpid_control.views.report.stages"), "repeated", lambda _run, windows: [None] * len(windows)
    )
    view = view_of(run, closed=lambda _scene, times: np.sin(times))
    np.testing.assert_array_equal(run.measured.beam, beam.values)
    np.testing.assert_array_equal(run.measured.time, beam.time)
    on_the_page = analysis_of(view.run)
    assert on_the_page is not None
    assert on_the_page.to_json() == analyse(signals).to_json()

    monkeypatch.setattr(compare, "view_of", lambda one: view_of(one, closed=lambda _scene, times: np.sin(times)))
    compared = compare.compare_bags(bag, bag)
    agrees(compared.runs[0].signals)
    assert compared.to_json()["origin"] == ["laser", "laser"]
    np.testing.assert_array_equal(compared.runs[1].view.run.motion.beam, beam.values)

    fitted: list[Signals] = []
    monkeypatch.setattr(calibrate_beam, "fit_beam", fitted.append)
    parser = argparse.ArgumentParser()
    calibrate_beam.add_arguments(parser)
    calibrate_beam._fitted(bag, parser.parse_args([str(bag)]))
    agrees(fitted[0])

    measured = read_measured(run)
    first = round((measured.begin - beam.time0) * RATE)
    np.testing.assert_array_equal(measured.beam, beam.values[first : first + len(measured.beam)])
    assert (measured.rate, measured.origin) == (beam.rate, beam.origin)

    path = exported(bag, "csv", tmp_path / "run.csv", "--topic", LASER)
    written = [pd.read_csv(file, comment="#", **EXACT) for file in (path, *tmp_path.glob("run.sensors_laser_?.csv"))]
    table = max(written, key=len)
    np.testing.assert_array_equal(table[f"{BEAM} [m]"], beam.values)
    np.testing.assert_array_equal(table["stamp [ns]"].iloc[0], beam.start_ns)
    np.testing.assert_allclose(table["time [s]"], beam.time, rtol=0.0, atol=1e-9)

    node = max((node for node in run.tree().leaves if BEAM in node), key=lambda node: node.sizes["time"])
    np.testing.assert_array_equal(node[BEAM], beam.values)

    if np.isfinite(support.values).all() and not support.others:
        times, values = support_series(run)
        np.testing.assert_array_equal(values, support.values)
        np.testing.assert_array_equal(times, support.time)


def test_a_gap_is_nan_and_a_restart_another_stream_that_is_named(tmp_path: Path) -> None:
    run = open_run(BAGS["gap and restart"](tmp_path / "bag"))
    beam = run.signal(BEAM)
    assert (len(beam.values), beam.lost, int(np.isnan(beam.values).sum())) == (2000, 200, 200)
    assert np.isnan(beam.values[500:700]).all()
    assert beam.others == ("sensors/laser_2: 600 samples, another stream, not used",)
    assert any("its index goes from 1999 to 0" in line for line in run.missing)
    with pytest.raises(BagError, match=r"lost or invalid at 0\.5 s"):
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


def test_a_type_without_a_definition_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = in_sqlite(tmp_path / "bag", definitions=False)
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as database:
        database.execute("UPDATE topics SET type = 'lab/msg/Thing' WHERE name = '/ceiling/state'")
        database.commit()
    (line,) = open_run(folder).missing
    assert "/ceiling/state: left out, without a definition in ros2msg that can be read" in line
    with closing(sqlite3.connect(next(folder.glob("*.db3")))) as database:
        database.execute("DROP TABLE messages")
        database.commit()
    assert main(["bag", "check", str(folder)]) == 2
    assert "needed: topics and messages, as rosbag2's" in capsys.readouterr().err


def test_origins_can_be_chosen_and_what_is_not_there_is_named() -> None:
    run = open_run(BAG)
    truth, laser = run.signal(BEAM, origin="truth"), run.signal(BEAM)
    assert (truth.origin, laser.origin, run.motion.origin, run.measured.origin) == ("truth", "laser", "truth", "laser")
    assert 1e-6 < np.abs(truth.values - laser.values).max() < 2e-4  # the laser's noise
    with pytest.raises(BagError, match=r"no samples of beam_displacement from accelerometer; channels in it: none"):
        run.signal(BEAM, origin="accelerometer")
    with pytest.raises(BagError, match=r"no samples of force; channels in it: beam_displacement, support_displacement"):
        run.signal("force")


def test_what_else_a_run_holds() -> None:
    run, bag = open_run(BAG), open_bag(BAG)
    heights = [message.height for _, message in bag.of_kind("CeilingCommand")]
    np.testing.assert_array_equal(run.commands.height, heights)
    np.testing.assert_array_equal(run.ceiling.height, [message.height for _, message in bag.of_kind("CeilingState")])
    np.testing.assert_array_equal(run.estimates.amplitude, [m.amplitude for _, m in bag.of_kind("Excitation")])
    assert [event.text for event in run.all_events] == [event.text for _, event in bag.of_kind("Event")]
    assert (run.scene is not None, run.scene_problem, run.scene_text) == (True, "", bag.scene_text)
    assert "identifier_node" in str(run.parameters["parameters"])
    assert (run.about, run.result) == (bag.run, bag.result)


def test_a_part_takes_its_samples_only_and_keeps_their_times() -> None:
    whole, part = open_run(BAG).signal(BEAM), open_run(BAG, begin=2.01, end=3.0).signal(BEAM)
    first = round(part.time0 * RATE)
    assert 1.9 < part.time0 <= 2.01
    assert len(part.values) < 1200
    np.testing.assert_array_equal(part.values, whole.values[first : first + len(part.values)])
    with pytest.raises(BagError, match=r"no sample from --from to --to; allowed: rising times from 0 to 8 s"):
        open_run(BAG, begin=9.0).signal(BEAM)
