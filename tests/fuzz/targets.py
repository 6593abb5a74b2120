# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parsers of what users, other programs and cables give: how each is read, and what is changed to harm it."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st
from mcap.records import Channel, Message, Schema
from mutations import as_yaml, bag_of, changed_arrays, changed_bag, changed_bytes, changed_document, records_of

from atpid_common.errors import AtpidError
from atpid_control.analysis import analyse
from atpid_control.analysis.signals import signals_of
from atpid_control.runs.playback import support_series
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import recover, repair
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import survey, verify
from atpid_control.stand.launching.options import OPTIONS, arguments_of, check_names, words_of
from atpid_control.stand.parameters import read_parameters
from atpid_control.stand.parts import NAMES
from atpid_control.stand.replay_files import write_replay_files
from atpid_control.views.report.view import view_of
from atpid_driver.calibration import fit, model
from atpid_driver.motor.faults import ProtocolError
from atpid_driver.motor.protocol import decode, encode, reply_of
from atpid_driver.standins.device import Control
from atpid_lab.validation import read_measured, scene_of
from atpid_sim.maps import HeightMap
from atpid_sim.scene import SeriesExcitation, load_scene
from atpid_sim.scene.excitation import Series
from atpid_sim.scene.series import read_series
from atpid_sim.simulation.batch import Journal

ROOT = Path(__file__).resolve().parent.parent.parent
BAG = ROOT / "bags/thesis_4_3_short"
#: The largest height a stand, however odd, has [m]: what a parser lets through must not exceed it.
_FARTHEST = 1e3


@dataclass(frozen=True)
class Target:
    """One parser. `file`: the name of what it reads; `read(path)` ends in an AtpidError or returns."""

    file: str
    read: Callable[[Path], object]
    inputs: Callable[[], st.SearchStrategy[bytes]]


@cache
def _texts(*patterns: str) -> list[bytes]:
    return [path.read_bytes() for pattern in patterns for path in sorted(ROOT.glob(pattern))]


@cache
def _arrays(path: str) -> dict[str, Any]:
    with np.load(ROOT / path) as stored:
        return {name: stored[name] for name in stored.files}


@cache
def _records() -> tuple[Any, ...]:
    """Return the records of a small bag: two messages of a topic, and one topic with a quality of service."""
    found = records_of((BAG / "bag_0.mcap").read_bytes(), 2)
    used = {one.channel_id for one in found if isinstance(one, Message)}
    channels = {one.id: one for one in found if isinstance(one, Channel) and one.id in used}
    schemas = {one.id: one for one in found if isinstance(one, Schema)}
    for place, channel in enumerate(channels.values()):
        profiles = yaml.safe_load(channel.metadata["offered_qos_profiles"])[: place == 0]
        channel.metadata["offered_qos_profiles"] = yaml.safe_dump(profiles, sort_keys=False)
    kept = [one for one in found if not isinstance(one, (Channel, Schema))]
    return (*(schemas[one.schema_id] for one in channels.values()), *channels.values(), *kept)


@cache
def _small_bag() -> bytes:
    return bag_of(_records())


@cache
def _small_metadata() -> bytes:
    """Return the metadata.yaml of the small bag, whose counts are right."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bag_0.mcap").write_bytes(_small_bag())
        repair(Path(folder))
        return (Path(folder) / "metadata.yaml").read_bytes()


def _yaml(*patterns: str) -> st.SearchStrategy[bytes]:
    documents = [yaml.safe_load(text) for text in _texts(*patterns)]
    return changed_bytes(_texts(*patterns)) | changed_document(documents).map(as_yaml)


def _scene(path: Path) -> None:
    scene = load_scene(path)
    scene.warnings()
    if isinstance(scene.excitation, SeriesExcitation):
        read_series(scene.excitation.series, scene.duration)


def _series(path: Path) -> None:
    times, values = read_series(Series(file=path), 0.1)
    assert np.isfinite(times).all()
    assert np.isfinite(values).all()


def _map(path: Path) -> None:
    found = HeightMap.load(path)
    for amplitude in (0.0, 1e-3, 0.0123, 0.08):
        with suppress(AtpidError):
            assert 0.0 < found.lookup(amplitude, float(found.mass_fractions[0])).height <= _FARTHEST


def _calibration(path: Path) -> None:
    made = model.load(path)
    ends = np.polynomial.polynomial.polyval(np.array(made.limits_volts), np.array(made.coefficients))
    assert np.isfinite(ends).all()


def _readings(path: Path) -> None:
    positions, volts = fit.read_readings(path)
    made = fit.fit(positions, volts, 1)
    assert np.isfinite(made.coefficients).all()


def _recording(path: Path) -> None:
    run = open_run(path)
    assert np.isfinite(signals_of(run, both=False)[0].rate)
    read_measured(run, 0.0, 9.0)


def _in_folder(path: Path) -> Path:
    """Return the folder of a bag with its metadata beside it."""
    if not (path.parent / "metadata.yaml").exists():
        (path.parent / "metadata.yaml").write_bytes(_small_metadata())
    return path.parent


def _bag(path: Path) -> None:
    folder = _in_folder(path)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    reads: list[Callable[[Path], object]] = [verify, survey, _messages, _recover, view_of]
    reads += [lambda bag: read_measured(open_run(bag), 0.0, 9.0), lambda bag: scene_of(open_run(bag))]
    reads += [lambda bag: support_series(open_run(bag)), lambda bag: write_replay_files(bag, bag / "replay")]
    for read in reads:
        with suppress(AtpidError):
            read(folder)
        assert {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()} == before
    for read in (repair, verify):
        with suppress(AtpidError):
            read(folder)
    assert before[path.name] in [file.read_bytes() for file in folder.iterdir() if file.name.startswith(path.name)]
    assert list(folder.parent.iterdir()) == [folder], "written outside the folder"


def _messages(folder: Path) -> None:
    bag = open_bag(folder)
    for topic in bag.types:
        with suppress(AtpidError):
            list(bag.messages(topic))


def _recover(folder: Path) -> None:
    """Recover a bag: the other one is whole."""
    made = recover(folder, folder / "again")
    assert not made.made or verify(folder / "again").messages == made.verified.messages
    shutil.rmtree(folder / "again", ignore_errors=True)


def _tables(path: Path) -> None:
    folder = _in_folder(path)
    run = open_run(folder)
    for frame in run.frames().values():
        assert list(frame.columns)
    signals, _ = signals_of(run)
    json.dumps(analyse(signals).to_json(), allow_nan=False)


def _metadata(path: Path) -> None:
    (path.parent / "bag_0.mcap").write_bytes(_small_bag())
    for read in (verify, repair):
        read(path.parent)


def _protocol(path: Path) -> None:
    for line in path.read_bytes().splitlines(keepends=True):
        with suppress(ProtocolError):
            reply_of(decode(line))


@st.composite
def _frames(draw: st.DrawFn) -> bytes:
    """Return lines as a board, a broken cable or another device sends them: some with a right check sum."""
    words = st.sampled_from(["ST", "ID", "NO", "", "XX", "st"]) | st.text("ABC,*$\r", max_size=4)
    fields = st.sampled_from(["0", "1", "-1", "-", "--1", "4294967295", "4294967296", "FFFF", "1e3", "", "9" * 90])
    field = fields | st.text(st.characters(max_codepoint=127), max_size=5)
    made = encode(draw(st.integers(0, 65535)), draw(words), *draw(st.lists(field, max_size=11)))
    return made + draw(changed_bytes([made, b"$1,ST,2,1,0000,200000,-,1,1,0,1*0000\n"]))


def _launch(path: Path) -> None:
    given = json.loads(path.read_text(encoding="utf-8"))
    for command in OPTIONS:
        with suppress(AtpidError):
            check_names(command, list(given))
        words_of(command, given)


def _launch_arguments() -> st.SearchStrategy[bytes]:
    names = [name for command in OPTIONS for name in arguments_of(command)]
    odd = ["", "~nobody/x", "/dev/zero", "/proc/self/mem", ".", "nan", "1e999", "-1", "x" * 300, "y/" * 3000]
    values = st.sampled_from([*odd, "$(python -c 1)", "scenes/standard.yaml", str(ROOT / "scenes/standard.yaml")])
    text = st.text(st.characters(exclude_characters="\0"), max_size=20)  # which no command line has
    table = st.dictionaries(st.sampled_from(names) | st.text(max_size=5), values | text)
    return table.map(lambda given: json.dumps(given).encode())


def _journal(path: Path) -> None:
    before = path.read_bytes()
    try:
        made = Journal(path, {"format": 1})
    except AtpidError:
        assert path.read_bytes() == before, "a file that is no journal was changed"
        raise
    made.close()


_JOURNAL = b'{"format": 1}\n{"point": [0.1, 0.01], "height": 0.1}\n'
_READINGS = b"position,volts\n-0.1,1\n0,3\n0.1,5\n0.12,5.4\n"
_TABLE = b"time,support_displacement,beam_displacement\n" + b"".join(b"%g,0.01,0.02\n" % (k / 100) for k in range(200))

TARGETS = {
    "scene": Target("scene.yaml", _scene, lambda: _yaml("scenes/*.yaml")),
    "series_csv": Target("series.csv", _series, lambda: changed_bytes([_TABLE])),
    "series_npz": Target(
        "series.npz", _series,
        lambda: changed_arrays({"time": np.arange(9.0), "support_displacement": np.zeros(9)}),
    ),
    "map": Target("map.npz", _map, lambda: changed_arrays(_arrays("atpid_control/config/maps/standard.npz"))),
    "calibration": Target("laser.yaml", _calibration, lambda: _yaml("atpid_driver/config/calibration/*.yaml")),
    "readings": Target("readings.csv", _readings, lambda: changed_bytes([_READINGS])),
    "recording": Target("recording.csv", _recording, lambda: changed_bytes([_TABLE])),
    "bag_bytes": Target("bag/bag_0.mcap", _bag, lambda: changed_bytes([_small_bag()])),
    "bag_records": Target("bag/bag_0.mcap", _bag, lambda: changed_bag(_records())),
    "bag_tables": Target("bag/bag_0.mcap", _tables, lambda: changed_bag(_records())),
    "metadata": Target("bag/metadata.yaml", _metadata, lambda: _yaml("bags/thesis_4_3_short/metadata.yaml")),
    "protocol": Target("serial", _protocol, _frames),
    "parameters": Target(
        "parameters.yaml",
        lambda path: read_parameters(path, NAMES),
        lambda: _yaml("atpid_*/config/*.yaml", "extensions/*/config/*.yaml"),
    ),
    "launch": Target("arguments.json", _launch, _launch_arguments),
    "journal": Target("map.npz.journal", _journal, lambda: changed_bytes([_JOURNAL])),
    "standin_control": Target(
        "control", lambda path: Control(path).close(), lambda: changed_bytes([b"ATPIDCT1" + bytes(4088)])
    ),
}  # fmt: skip
