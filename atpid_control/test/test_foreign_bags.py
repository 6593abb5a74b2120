# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders: closed without a result, with topics that cannot be decoded, in sqlite3; run folders."""

import re
import shutil
import struct
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from bag_files import BAG, EMPTY, OWN, exported, rewritten, with_topic
from mcap.writer import Writer
from recorded import LASER, refused
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2
from rosbags.typesys import Stores, get_typestore

from atpid_control.cli import main
from atpid_control.runs.check import check
from atpid_control.runs.playback import load_playback
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run

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


def test_check_states_that_another_program_recorded_it(foreign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "check", str(foreign)]) == 0
    said = capsys.readouterr().out
    assert re.search(r"finished: 8 s .* 160 .*; recorded by another", said)
    assert re.search(r"no findings; 160 ", said)
    assert "limits" in said
    assert not re.search(r"\bnan\b|not closed", said)


def test_verify_counts_what_it_cannot_decode(foreign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "verify", str(foreign)]) == 0
    said = capsys.readouterr().out
    assert f"1  {SERVICE}" in said
    assert re.search(rf"not decoded: {SERVICE}: .*'lab/msg/Thing'", said)
    assert "lost" not in said


def test_a_definition_of_our_own_that_cannot_be_read_is_damage(tmp_path: Path) -> None:
    with (tmp_path / "bag_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="atpid_control")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a/msg/B", "ros2msg", DEFINITION))
        writer.add_message(channel, 0, b"\0\1\0\0", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    assert main(["bag", "verify", str(tmp_path)]) == 2


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


def test_a_bag_in_sqlite3_is_read_and_one_that_is_damaged_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = in_rosbag2(tmp_path / "old", StoragePlugin.SQLITE3, "Bool", serialised("Bool", True), None)
    assert main(["bag", "verify", str(bag)]) == 0
    assert re.search(r"\b1 messages .*0\.000 s", capsys.readouterr().out)
    ((_, message),) = open_bag(bag).messages("/a")
    assert message.data is True
    file = next(bag.glob("*.db3"))
    file.write_bytes(file.read_bytes()[:5000])
    refused(capsys, ["bag", "verify", bag], "`.recover`", "sqlite3")


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_messages_that_rosbag2_has_compressed_are_read_and_files_named(
    storage: StoragePlugin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = serialised("String", "b" * 1000)
    bag = in_rosbag2(tmp_path / "message", storage, "String", text, CompressionMode.MESSAGE)
    assert main(["bag", "verify", str(bag)]) == 0
    ((_, message),) = open_bag(bag).messages("/a")
    assert message.data == "b" * 1000
    bag = in_rosbag2(tmp_path / "file", storage, "String", text, CompressionMode.FILE)
    refused(capsys, ["bag", "verify", bag], ".zstd", "`rosbags-convert --src")


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_compressed_message_that_is_damaged_is_one_line(
    storage: StoragePlugin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = in_rosbag2(tmp_path / "bag", storage, "Bool", b"\x28\xb5\x2f\xfd" + bytes(9), None)
    refused(capsys, ["bag", "verify", bag], "std_msgs/msg/Bool")


COMMANDS = (
    ["bag", "analyse", "{bag}", "--out", "{out}"], ["bag", "compare", "{bag}", str(BAG), "--out", "{out}"],
    ["bag", "compare", str(BAG), "{bag}", "--out", "{out}"], ["bag", "report", "{bag}", "--out", "{out}"],
    ["bag", "validate", "{bag}", "--out", "{out}"],
    ["bag", "export", "{bag}", "--format", "csv", "--out", "{out}/a.csv"],
    ["bag", "traces", "{bag}", "--out", "{out}/a.mcap"], ["replay", "{bag}", "--out", "{out}"],
    ["calibrate", "beam", "{bag}", "--moving-mass", "1", "--out", "{out}/a.yaml"],
)  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: f"{words[0]} {words.index('{bag}')}")
def test_a_bag_that_is_none_leaves_nothing_behind(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [word.format(bag=tmp_path / "none", out=tmp_path / "new") for word in words]
    refused(capsys, given, f"{tmp_path / 'none'}: no such")
    assert not list(tmp_path.iterdir())


def test_the_folder_of_a_run_stands_for_its_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("atpid_control.commands.analyse.panels", lambda _found: ())  # numbers, no pictures
    run = tmp_path / "run"
    shutil.copytree(BAG, run / "bag")
    assert main(["bag", "analyse", str(run), "--out", str(tmp_path / "out"), "--to", "2.0"]) == 0
    exported(run, "csv", tmp_path / "a.csv", "--topic", LASER)
    assert main(["bag", "verify", str(run)]) == 0
