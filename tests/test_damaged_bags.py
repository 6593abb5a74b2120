# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags that are cut off, damaged or of other recorders: every reader reads what can be used, and states the rest."""

import functools
import json
import math
import random
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from bag_files import BAG, BEAM, EMPTY, OWN, ROOT, Change, exported, jumps, rewritten, with_topic, without_pictures
from hypothesis import settings
from mcap.records import Schema
from mcap.writer import Writer
from recorded import LASER, Capture, block, refused
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2
from rosbags.typesys import Stores, get_typestore

from atpid_common.errors import InputError
from atpid_control.cli import main
from atpid_control.runs.check import check
from atpid_control.runs.decode import Decoder, message_type
from atpid_control.runs.playback import load_playback
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import recover
from atpid_control.runs.run import open_run
from atpid_control.runs.source import LONGEST_GAP, Segments
from atpid_control.stand.summary import stage_table, summary_of, write_summary
from atpid_control.views.report.page import page
from atpid_control.views.report.picture import save_pictures
from atpid_control.views.report.view import View, view_of

LONG = settings.get_current_profile_name() == "long"
CUT = ROOT / "bags/cut_off"
HALF = (BAG / "bag_0.mcap").stat().st_size // 2
#: What each command is given besides the bag and `--out`, and what it makes.
COMMANDS: dict[str, tuple[list[str], str]] = {
    "analyse": ([], "out"),
    "compare": ([str(BAG)], "out"),
    "export": (["--format", "csv"], "a.csv"),
    "report": ([], "out"),
    "traces": ([], "a.mcap"),
    "validate": ([], "out"),
}


def quick_view(bag: Path) -> View:
    """Return the view of a bag beside a sine, in place of a simulation."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("atpid_control.views.report.stages.closed_by_simulation", lambda _scene, times: np.sin(times))
        return view_of(bag)


# cut off, or without index


def missing(bag: Path) -> list[str]:
    """Return what is missing in a bag, besides samples lost by index."""
    return open_bag(bag, torn_ok=True).missing


def cut(folder: Path, size: int | None, about: bool = False) -> Path:
    """Write a bag that holds the first bytes of the recorded one; return its folder."""
    folder.mkdir()
    (folder / "bag_0.mcap").write_bytes((BAG / "bag_0.mcap").read_bytes()[:size])
    if about:
        shutil.copy(BAG / "metadata.yaml", folder)
    return folder


@pytest.mark.parametrize("command", list(COMMANDS))
def test_each_command_reads_what_is_there_and_prints_the_same_line(
    command: str, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_pictures(monkeypatch)
    before = (CUT / "bag_0.mcap").read_bytes()
    more, name = COMMANDS[command]
    out = tmp_path / name
    assert main(["bag", command, str(CUT), *more, "--out", str(out)]) == 0
    printed = capsys.readouterr()
    (line,) = missing(CUT)
    assert line.startswith(f"{CUT}/bag_0.mcap: ")
    assert {"2.55", "2549", LASER + ";", "recover"} <= set(line.split())
    assert [row for row in printed.out.splitlines() if row.startswith("missing: ")] == [f"missing: {line}"]
    assert printed.err == ""
    assert (CUT / "bag_0.mcap").read_bytes() == before
    assert command != "report" or "2549" in (out / "report.html").read_text()
    for file in out.glob("*.json"):
        assert json.loads(file.read_text())["missing"] == [line]


def test_the_samples_before_the_cut_are_those_of_the_whole_bag() -> None:
    few, every = (open_run(path).signal(BEAM).values for path in (CUT, BAG))
    assert len(few) == 2550
    np.testing.assert_array_equal(few, every[:2550])


@pytest.mark.parametrize(
    ("size", "about", "part"), [(None, False, ""), (None, True, ""), (-100, True, "index"), (HALF, True, "damaged")]
)
def test_what_is_missing_is_stated(size: int | None, about: bool, part: str, tmp_path: Path) -> None:
    """Nothing of a whole bag, with and without its metadata; of one without its index no message."""
    bag = cut(tmp_path / "bag", size, about)
    read, lines = open_bag(bag, torn_ok=True), missing(bag)
    blocks = sum(1 for _ in read.messages(LASER))
    assert bool(lines) == bool(part)
    if part:
        assert lines[0].startswith(f"{bag}/bag_0.mcap: ")
        assert part in lines[0]
        assert f"recover {bag}`" in lines[0]
    if size == HALF:
        assert str(50 * blocks - 1) in lines[0].split()
        assert any(line.startswith(f"{bag}: {LASER}: {160 - blocks} of 160 ") for line in lines[1:])
    else:
        assert len(read.raw) == len(open_bag(BAG).raw)


def test_a_damaged_part_ends_the_reading_and_recover_saves_what_follows(tmp_path: Path) -> None:
    bag = cut(tmp_path / "bag", None, about=True)
    data = bytearray((bag / "bag_0.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    (bag / "bag_0.mcap").write_bytes(data)
    assert "damaged" in missing(bag)[0]
    again = tmp_path / "again"
    recover(bag, again)
    (line,) = missing(again)
    assert line.startswith(f"{again}: recovered ")
    assert len(open_bag(again).raw) > len(open_bag(bag, torn_ok=True).raw)


def test_a_bag_cut_before_its_first_sample_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    bag = cut(tmp_path / "bag", 3000)
    (line,) = missing(bag)
    assert {"before", "0"} <= set(line.split())
    for command, (more, name) in COMMANDS.items():
        if command != "traces":  # a file without traces
            refused(capsys, ["bag", command, bag, *more, "--out", tmp_path / command / name])


def test_metadata_that_cannot_be_read_is_stated(tmp_path: Path) -> None:
    bag = cut(tmp_path / "bag", None, about=True)
    (bag / "metadata.yaml").write_text("a: [1")
    (line,) = missing(bag)
    assert {"metadata.yaml", "rosbag2"} <= set(re.findall(r"[\w.]+", line))


# indices that jump, rates and stamps that cannot be

HOUR = 3_600_000  # of scans
BLOCKS = (LASER, "/plant/truth")


def several(topic: str, place: int, message: Any) -> None:
    if topic in BLOCKS:
        message.first_index += (0, 2**30, 5, 2**50, HOUR)[place // 32]


def hole(topic: str, place: int, _message: Any) -> bool:
    return not (topic in BLOCKS and 60 <= place < 120)


def rates(topic: str, place: int, message: Any) -> None:
    if topic in BLOCKS and place % 10 == 3:
        message.rate = (math.nan, 0.0, -1000.0, math.inf, 1e-9)[place // 10 % 5]


def stamps(_topic: str, place: int, message: Any) -> None:
    if place > 50 and hasattr(message, "header"):
        message.header.stamp.sec += 5000 if place < 100 else -20


def gap_and_jump(topic: str, place: int, message: Any) -> bool:
    """A table with a gap of 1.5 s that is filled, and after it another of its own."""
    if topic in BLOCKS and place >= 120:
        message.first_index += 2**50
    return not (topic in BLOCKS and 60 <= place < 90)


CHANGES: dict[str, Change] = {
    "early": jumps(40, 2**40), "late": jumps(120, 2**61), "laser only": jumps(60, 2**40, truth=False),
    "largest": jumps(80, 2**63 - 1), "one block": jumps(80, 2**61, length=1), "back": jumps(80, -4000),
    "hour": jumps(80, HOUR), "half a minute": jumps(80, 30_000), "several": several, "hole": hole, "rates": rates,
    "stamps": stamps, "gap and jump": gap_and_jump,
}  # fmt: skip
#: Part of the line that names what happened, else the index; a gap is filled and counted.
NAMED = {"stamps": "stamp", "hole": " 3000 ", "half a minute": " 30000 ", "rates": "rate", "largest": "last index"}
#: Of each kind of table one, with a format: beside another of its own index, with rows filled in, of several parts,
#: with blocks left out by their index, rate or stamp. The long profile takes all.
READ = {
    "laser only": ("csv",), "gap and jump": ("csv",), "largest": ("mat",), "half a minute": ("csv",),
    "several": ("csv", "uff"), "rates": ("uff",), "stamps": ("mat",),
}  # fmt: skip
FORMATS = ("csv", "mat", "uff")


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return what gives the bag with a change, written once."""
    folder = tmp_path_factory.mktemp("jumps")
    return functools.cache(lambda name: rewritten(folder / name, CHANGES[name]))


@pytest.mark.parametrize("name", CHANGES)
def test_a_report_and_the_summary_of_a_bench(name: str, bags: Callable[[str], Path], tmp_path: Path) -> None:
    """Each stage is there, null where it has no sample."""
    view = quick_view(bags(name))
    scene = view.run.scene
    assert scene is not None
    summary = summary_of(view, scene, "lockstep")
    write_summary(summary, tmp_path / "summary.json")
    kept = json.loads((tmp_path / "summary.json").read_text())
    time = view.run.motion.time
    assert [stage["amplitude"] is None for stage in kept["stages"]] == [
        not np.isfinite(view.beam[(time >= begin) & (time <= end)]).any() for begin, end in view.windows
    ]
    stage_table(view.stages, None, "m")
    assert np.isfinite(view.run.motion.beam).sum() <= 8000
    assert view.run.duration < 8.1 + (30.0 if name == "half a minute" else 0.0)
    assert kept["missing"]


@pytest.mark.parametrize("name", CHANGES if LONG else READ)
def test_every_reader_ends_and_names_it(
    name: str, bags: Callable[[str], Path], tmp_path: Path, capsys: Capture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    without_pictures(monkeypatch)
    folder, out = bags(name), tmp_path / "out"
    for form in FORMATS if LONG else READ[name]:
        exported(folder, form, out / f"a.{form}")
        said = capsys.readouterr().out
        assert NAMED.get(name, "its index") in said
        assert len(said.splitlines()) < 25
    rows = sum(len(pd.read_csv(path, comment="#")) for path in out.glob("*.csv"))
    assert rows < 22_000 * (1 if name != "half a minute" else 5)
    assert main(["bag", "analyse", str(folder), "--out", str(out / "analysis")]) == 0
    assert main(["bag", "traces", str(folder), "--out", str(out / "traces.mcap")]) == 0


def test_a_later_segment_keeps_its_place_in_the_run(bags: Callable[[str], Path]) -> None:
    run, whole = quick_view(bags("early")).run, quick_view(BAG).run
    np.testing.assert_allclose(run.motion.time, whole.motion.time[2000:], atol=1e-9)
    np.testing.assert_array_equal(run.motion.beam, whole.motion.beam[2000:])
    assert run.start_ns == whole.start_ns


@pytest.fixture(scope="module")
def made() -> Callable[..., Any]:
    """Return what makes a decoded block of the laser."""
    name, decoder = "atpid_interfaces/msg/SampleBlock", Decoder()
    decoder.add(Schema(1, message_type(name).definition.encode(), "ros2msg", name))

    def make(index: int, at: float, scans: int = 100) -> Any:
        return decoder.decode(1, block(index, np.zeros((scans, 2)), start_ns=round((at - index / 1000.0) * 1e9)))

    return make


def test_what_is_one_segment_and_what_is_another(made: Callable[..., Any]) -> None:
    longest = round(LONGEST_GAP * 1000)
    for ahead, same in ((0, True), (1, True), (longest, True), (longest + 1, False), (2**40, False), (-150, False)):
        found = Segments()
        first, second = found.place(made(100, 1.0)), found.place(made(200 + ahead, 2.0))
        assert not isinstance(second, str)
        assert (first is second) == same
        assert second.lost == (ahead if same else 0)
        named = {"199", f"{200 + ahead},", "1000"} <= set(second.jump.split())
        assert (second.jump == "", named) == (same, not same)


def test_blocks_among_others_are_no_end_of_a_segment_nor_do_its_gaps_outgrow_it(made: Callable[..., Any]) -> None:
    """However many jumps of less than a minute there are, the rows of a bag are a multiple of its samples."""
    found, gaps = Segments(), Segments()
    for number in range(30):
        found.place(made(number * 100 + (2**50 if number % 3 == 1 else 0), number * 0.1))
    assert [(one.scans, one.lost) for one in found.all] == [(2000, 1000), (1000, 1800)]
    for number in range(200):
        gaps.place(made(number * 59_000, number * 59.0))
    assert sum(one.scans + one.lost for one in gaps.all) < 20 * (LONGEST_GAP * 1000 + 11 * 20_000)


# values that cannot be

KINDS = ("Excitation", "CeilingCommand", "CeilingState", "SampleBlock", "PlantTruth", "Event")
NUMBERS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e-308, 0.0, -1.0)
COUNTS = (0, 2**32 - 1, 2**62, 2**63, 2**64 - 1)


@pytest.fixture(scope="module")
def brief(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the first 3 s of the recorded bag."""
    return rewritten(tmp_path_factory.mktemp("brief") / "bag", lambda _topic, place, _message: place < 60)


def odd(source: Path, folder: Path, kind: str, change: Callable[[Any], None], share: float, seed: int = 0) -> Path:
    """Write a bag with a share of its messages of a kind changed."""
    chance, topics = random.Random(seed), set(open_bag(source).topics_of(kind))

    def some(topic: str, _place: int, message: Any) -> None:
        if chance.random() < share and topic in topics:
            change(message)

    return rewritten(folder, some, source)


def chosen(chance: random.Random) -> Callable[[Any], None]:
    """Return a change of one field, the same for every message."""
    field: list[str] = []

    def change(message: Any) -> None:
        names = [name for name in getattr(message, "__slots__", None) or vars(message)]
        field[:] = field or [chance.choice(names)]
        value = getattr(message, field[0])
        if isinstance(value, float):
            setattr(message, field[0], chance.choice(NUMBERS))
        elif isinstance(value, int) and not isinstance(value, bool):
            setattr(message, field[0], chance.choice(COUNTS))
        elif isinstance(value, np.ndarray) and len(value):
            changed = np.array(value, dtype=float)
            changed[chance.randrange(len(changed))] = chance.choice(NUMBERS)
            setattr(message, field[0], changed[: chance.choice([len(changed), chance.randrange(len(changed))])])
        elif isinstance(value, str):
            setattr(message, field[0], chance.choice(["", "\x00<b>", "x" * 3000]))
        elif hasattr(value, "stamp"):
            value.stamp.sec = chance.choice([0, -(2**31), 2**31 - 1])

    return change


def test_a_report_is_made_of_whatever_can_be_used(brief: Path, tmp_path: Path) -> None:
    """Each kind of message once; some times in the long profile."""
    made, count = 0, len(KINDS) * (5 if LONG else 1)
    for seed in range(count):
        chance, kind = random.Random(seed), KINDS[seed % len(KINDS)]
        bag = odd(brief, tmp_path / f"{seed}", kind, chosen(chance), chance.choice([0.01, 0.3, 1.0]), seed)
        try:
            view = quick_view(bag)
        except InputError as error:  # not one block of displacements is left
            assert "\n" not in str(error)  # noqa: PT017
            continue
        assert "<html" in page(view)
        made += 1
        if seed % 6 == 0:
            save_pictures(view, tmp_path)
    assert made >= count - count // len(KINDS)  # blocks of displacements are one of the kinds


def test_what_is_left_out_stands_in_the_report(brief: Path, tmp_path: Path) -> None:
    def nonsense(message: Any) -> None:
        message.amplitude = -1.0

    view = quick_view(odd(brief, tmp_path / "odd", "Excitation", nonsense, 0.5))
    (line,) = view.run.missing
    assert line.startswith("excitation: ")
    assert {"amplitude", "-1.0"} <= set(line.split())
    assert line in page(view)
    assert len(view.run.estimates.time) + int(line.split()[1]) == 60


SERVICE = "/test_service1/_service_event"
#: rosbag2 keeps such a one of a service: its own types are missing.
DEFINITION = b"service_msgs/ServiceEventInfo info\ntest_msgs/BasicTypes_Request[<=1] request\n"
STORE = get_typestore(Stores.ROS2_JAZZY)
#: Encodings of message and definition, the definition, a message, and why it is left out.
FOREIGN = {
    "json": (("json", "jsonschema"), b'{"type": "object"}', b'{"a": 1}', "'json'"),
    "idl": (("cdr", "ros2idl"), b"module lab { struct Thing { double a; }; };", EMPTY, "ros2msg"),
    "without definition": (("json", ""), b"", b'{"a": 1}', "'json'"),
    "types missing": (("cdr", "ros2msg"), DEFINITION, EMPTY, "ros2msg"),
}


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recorded bag as rosbag2 writes it: no records or files of ours, and a message of a service."""
    folder = with_topic(tmp_path_factory.mktemp("foreign") / "bag", DEFINITION, EMPTY, SERVICE)
    about = yaml.safe_load((BAG / "metadata.yaml").read_text())
    listed = about["rosbag2_bagfile_information"]
    entries = listed["topics_with_message_count"]
    own = {"name": SERVICE, "type": "lab/msg/Thing", "type_description_hash": ""}
    entries.append({"topic_metadata": entries[0]["topic_metadata"] | own, "message_count": 1})
    listed["custom_data"] = None
    (folder / "metadata.yaml").write_text(yaml.safe_dump(about))
    return folder


def test_check_states_that_another_program_recorded_it(foreign: Path, capsys: Capture) -> None:
    assert main(["bag", "check", str(foreign)]) == 0
    said = capsys.readouterr().out
    assert re.search(r"finished: 8 s .* 160 .*; recorded by another", said)
    assert re.search(r"no findings; 160 ", said)
    assert "limits" in said
    assert f"1  {SERVICE}" in said
    assert re.search(rf"not decoded: {SERVICE}: .*'lab/msg/Thing'", said)
    assert not re.search(r"\bnan\b|not closed|lost: ", said)


def test_a_definition_of_our_own_that_cannot_be_read_is_damage(tmp_path: Path) -> None:
    with (tmp_path / "bag_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="atpid_control")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a/msg/B", "ros2msg", DEFINITION))
        writer.add_message(channel, 0, b"\0\1\0\0", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    assert main(["bag", "check", "--file", str(tmp_path)]) == 2


@pytest.mark.parametrize("name", list(FOREIGN))
def test_another_encoding_is_left_out_and_stated(name: str, tmp_path: Path) -> None:
    encodings, definition, data, why = FOREIGN[name]
    run = tmp_path / "run"
    tree, whole = open_run(with_topic(run, definition, data, encodings=encodings)).tree(), open_run(BAG).tree()
    assert {node.path for node in tree.leaves} == {node.path for node in whole.leaves}
    assert tree["sensors/laser"].to_dataset().equals(whole["sensors/laser"].to_dataset())
    (line,) = tree.attrs["missing"]
    assert line.startswith(f"{run}: /foreign: left out, ")
    assert why in line


def test_a_type_of_another_package_is_a_table_with_units(tmp_path: Path) -> None:
    data = b"\0\1\0\0" + struct.pack("<dII2s", 293.15, 1, 2, b"x\0")
    tree = open_run(with_topic(tmp_path / "run", data=data)).tree()
    room = tree["foreign"].to_dataset()
    assert (room["temperature"].item(), room["temperature"].attrs["units"]) == (293.15, "K")
    assert room["names"].item() == '["x"]'
    assert tree.attrs["missing"] == []


def test_a_type_that_is_defined_twice_has_the_columns_of_each(tmp_path: Path) -> None:
    """As a recorder writes it that goes on in the file after the package was built anew."""
    values = {b"float64 a # [m] first\n": 1.5, b"float64 a # [m] first\nfloat64 b # [s] second\n": 2.5}
    with (tmp_path / "bag_0.mcap").open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2", library="test")
        for number, (definition, value) in enumerate(values.items()):
            schema = writer.register_schema("lab/msg/Thing", "ros2msg", definition)
            data = b"\0\1\0\0" + struct.pack("<d", value) * (number + 1)
            writer.add_message(writer.register_channel("/lab", "cdr", schema), number, data, number)
        writer.finish()  # type: ignore[no-untyped-call]
    tree = open_run(tmp_path).tree()
    first, second = (tree[name].to_dataset() for name in ("lab", "lab_definition_2"))
    assert (first["a"].item(), "b" in first) == (1.5, False)
    assert (second["a"].item(), second["b"].item(), second["b"].attrs["units"]) == (2.5, 2.5, "s")


@pytest.mark.parametrize(("topic", "place"), [("/sensors", "sensors/messages"), ("/../x", "_/x"), ("/", "_")])
def test_a_topic_above_others_or_with_no_name_has_its_place(topic: str, place: str, tmp_path: Path) -> None:
    run = open_run(with_topic(tmp_path / "run", OWN, EMPTY, topic))
    tree = run.tree()
    assert tree[place]["temperature"].item() == 0.0
    assert tree["sensors/laser"].sizes["time"] > 1
    assert set(run.frames()) == {node.path.strip("/") for node in tree.leaves}


def test_handshakes_which_rosbag2_records_as_well_are_no_part_of_the_run(tmp_path: Path) -> None:
    def handshakes(_topic: str, place: int, message: Any) -> None:
        if place < 3 and hasattr(message, "handshake"):
            message.handshake, message.header.stamp.sec, message.header.stamp.nanosec = True, 0, 0
            if hasattr(message, "data"):
                message.data = message.data[:0]
        elif hasattr(message, "header"):
            message.header.stamp.sec += 1_000

    def left_out(topic: str, place: int, message: Any) -> bool:
        handshakes(topic, place, message)
        return place >= 3 or not hasattr(message, "handshake")

    recorded, recorded_without = rewritten(tmp_path / "a", handshakes), rewritten(tmp_path / "b", left_out)
    found, expected = check(recorded), check(recorded_without)
    assert (found.findings, found.events, found.blocks) == (expected.findings, expected.events, expected.blocks)
    run, same = open_run(recorded), open_run(recorded_without)
    assert (run.blocks, run.lost) == (same.blocks, same.lost) == (160 - 3, 0)
    frames = run.frames()
    for name, table in same.frames().items():
        pd.testing.assert_frame_equal(frames[name], table)
    assert load_playback(recorded, ["*"]).items == load_playback(recorded_without, ["*"]).items
    (file,) = recorded.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    torn = open_bag(recorded, torn_ok=True)
    assert any(re.search(r"after \d\.\d+ s", line) for line in torn.missing), torn.missing


def in_rosbag2(folder: Path, storage: StoragePlugin, name: str, data: bytes, mode: CompressionMode | None) -> Path:
    """Write a bag of rosbag2 with one message on /a; return its folder."""
    writer = Rosbag2(folder, version=9, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/a", f"std_msgs/msg/{name}", typestore=STORE)
        writer.write(connection, 1, data)
    return folder


def serialised(name: str, data: Any) -> bytes:
    kind = f"std_msgs/msg/{name}"
    return bytes(STORE.serialize_cdr(STORE.types[kind](data=data), kind))


def test_a_bag_in_sqlite3_is_read_and_one_that_is_damaged_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    bag = in_rosbag2(tmp_path / "old", StoragePlugin.SQLITE3, "Bool", serialised("Bool", True), None)
    assert main(["bag", "check", "--file", str(bag)]) == 0
    assert re.search(r"\b1 messages .*0\.000 s", capsys.readouterr().out)
    ((_, message),) = open_bag(bag).messages("/a")
    assert message.data is True
    file = next(bag.glob("*.db3"))
    file.write_bytes(file.read_bytes()[:5000])
    refused(capsys, ["bag", "check", "--file", bag], "`.recover`", "sqlite3")


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_compressed_messages_are_read_and_files_named(storage: StoragePlugin, tmp_path: Path, capsys: Capture) -> None:
    text = serialised("String", "b" * 1000)
    bag = in_rosbag2(tmp_path / "message", storage, "String", text, CompressionMode.MESSAGE)
    assert main(["bag", "check", "--file", str(bag)]) == 0
    ((_, message),) = open_bag(bag).messages("/a")
    assert message.data == "b" * 1000
    bag = in_rosbag2(tmp_path / "file", storage, "String", text, CompressionMode.FILE)
    refused(capsys, ["bag", "check", "--file", bag], ".zstd", "`rosbags-convert --src")
    bag = in_rosbag2(tmp_path / "damaged", storage, "Bool", b"\x28\xb5\x2f\xfd" + bytes(9), None)
    refused(capsys, ["bag", "check", "--file", bag], "std_msgs/msg/Bool")


MORE_COMMANDS = [["replay", "{none}", "--out", "{out}"], ["bag", "compare", str(BAG), "{none}", "--out", "{out}"],
                 ["calibrate", "beam", "{none}", "--moving-mass", "1", "--out", "{out}/a.yaml"]]  # fmt: skip


def test_a_bag_that_is_none_leaves_nothing_behind(tmp_path: Path, capsys: Capture) -> None:
    of_bags = [["bag", name, "{none}", *more, "--out", f"{{out}}/{made}"] for name, (more, made) in COMMANDS.items()]
    for words in [*of_bags, *MORE_COMMANDS]:
        given = [word.format(none=tmp_path / "none", out=tmp_path / "new") for word in words]
        refused(capsys, given, f"{tmp_path / 'none'}: no such")
        assert not list(tmp_path.iterdir())
