# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders: closed without a result, with topics that cannot be decoded, in sqlite3; run folders."""

import re
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from mcap.records import Channel, Message, Schema
from mcap.writer import Writer
from rewritten import BAG, rewritten
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2
from rosbags.typesys import Stores, get_typestore

from atpid_control.cli import main
from atpid_control.runs.check import check
from atpid_control.runs.playback import load_playback
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import records
from atpid_control.runs.run import open_run

SERVICE = "/test_service1/_service_event"
#: rosbag2 keeps such a one of a service: its own types are missing.
DEFINITION = b"service_msgs/ServiceEventInfo info\ntest_msgs/BasicTypes_Request[<=1] request\n"


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recorded bag as rosbag2 writes it: no records or files of ours, and messages of a service."""
    folder, listed = tmp_path_factory.mktemp("foreign") / "bag", "rosbag2_bagfile_information"
    folder.mkdir()
    with (folder / "bag_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="libmcap 1.4.0")
        topics = set()
        for record in records(BAG / "bag_0.mcap"):
            if isinstance(record, Schema):
                writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in topics:
                writer.register_channel(record.topic, "cdr", record.schema_id, record.metadata)
                topics.add(record.id)
            elif isinstance(record, Message):
                writer.add_message(record.channel_id, record.log_time, record.data, record.publish_time)
        schema = writer.register_schema("test_msgs/srv/BasicTypes_Event", "ros2msg", DEFINITION)
        channel = writer.register_channel(SERVICE, "cdr", schema)
        for number in range(4):
            writer.add_message(channel, number, b"\0\1\0\0" + bytes(8), number)
        writer.finish()  # type: ignore[no-untyped-call]
    about = yaml.safe_load((BAG / "metadata.yaml").read_text())
    entries = about[listed]["topics_with_message_count"]
    own = {"name": SERVICE, "type": "test_msgs/srv/BasicTypes_Event", "type_description_hash": ""}
    entries.append({"topic_metadata": entries[0]["topic_metadata"] | own, "message_count": 4})
    about[listed]["custom_data"] = None
    (folder / "metadata.yaml").write_text(yaml.safe_dump(about))
    return folder


def test_check_states_that_another_program_recorded_it(foreign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "check", str(foreign)]) == 0
    said = capsys.readouterr().out
    assert "finished: 8 s simulated in 160 blocks; recorded by another program: there is no result in it\n" in said
    assert "no findings; 160 blocks answered" in said
    assert "its limits are not in the bag" in said
    assert "nan" not in said
    assert "not closed" not in said


def test_verify_counts_what_it_cannot_decode(foreign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "verify", str(foreign)]) == 0
    said = capsys.readouterr().out
    assert f"4  {SERVICE}" in said
    assert f"counted, not decoded: {SERVICE}: the definition of 'test_msgs/srv/BasicTypes_Event' cannot be read" in said
    assert "lost" not in said


def test_a_definition_of_our_own_that_cannot_be_read_is_damage(tmp_path: Path) -> None:
    with (tmp_path / "bag_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="atpid_control")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a/msg/B", "ros2msg", DEFINITION))
        writer.add_message(channel, 0, b"\0\1\0\0", 0)
        writer.finish()  # type: ignore[no-untyped-call]
    assert main(["bag", "verify", str(tmp_path)]) == 2


def test_it_is_read_without_the_topics_that_cannot_be(foreign: Path) -> None:
    bag = open_bag(foreign)
    assert len(list(bag.messages("/sensors/laser"))) == 160
    (line,) = bag.missing
    assert f"{SERVICE}: left out, without a definition in ros2msg that can be read" in line


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
    assert (run.blocks, run.lost) == (same.blocks, same.lost) == (open_run(BAG).blocks - 3, 0)
    for name, table in same.frames().items():
        pd.testing.assert_frame_equal(run.frames()[name], table)
    assert load_playback(recorded, ["*"]).items == load_playback(recorded_without, ["*"]).items
    (file,) = recorded.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    torn = open_bag(recorded, torn_ok=True)
    assert any(re.search(r"damaged after \d\.\d+ s", line) for line in torn.missing), torn.missing


def test_a_bag_in_sqlite3_is_read_and_one_that_is_damaged_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Rosbag2(tmp_path / "old", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/a", "std_msgs/msg/Bool", typestore=store)
        kind = store.types["std_msgs/msg/Bool"]
        writer.write(connection, 1, store.serialize_cdr(kind(data=True), "std_msgs/msg/Bool"))
    assert main(["bag", "verify", str(tmp_path / "old")]) == 0
    assert "1 messages over 0.000 s" in capsys.readouterr().out
    ((_, message),) = open_bag(tmp_path / "old").messages("/a")
    assert message.data is True
    file = next((tmp_path / "old").glob("*.db3"))
    file.write_bytes(file.read_bytes()[:5000])
    assert main(["bag", "verify", str(tmp_path / "old")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "`.recover` of the program sqlite3 saves what is whole" in said


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_messages_that_rosbag2_has_compressed_are_read_and_files_named(
    storage: StoragePlugin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = store.types["std_msgs/msg/String"]
    for mode in (CompressionMode.MESSAGE, CompressionMode.FILE):
        writer = Rosbag2(tmp_path / mode.name, version=9, storage_plugin=storage)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=store)
            writer.write(connection, 1, store.serialize_cdr(kind(data="b" * 1000), "std_msgs/msg/String"))
    assert main(["bag", "verify", str(tmp_path / "MESSAGE")]) == 0
    ((_, message),) = open_bag(tmp_path / "MESSAGE").messages("/a")
    assert message.data == "b" * 1000
    capsys.readouterr()
    assert main(["bag", "verify", str(tmp_path / "FILE")]) == 2
    said = capsys.readouterr().err
    assert (said.count("\n"), ".zstd: compressed as a file by rosbag2; `rosbags-convert --src" in said) == (1, True)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_compressed_message_that_is_damaged_is_one_line(
    storage: StoragePlugin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Rosbag2(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/a", "std_msgs/msg/Bool", typestore=get_typestore(Stores.ROS2_JAZZY))
        writer.write(connection, 1, b"\x28\xb5\x2f\xfd" + bytes(9))
    assert main(["bag", "verify", str(tmp_path / "bag")]) == 2
    assert "a message of type std_msgs/msg/Bool cannot be decoded" in capsys.readouterr().err


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
    assert main(given) == 2
    assert capsys.readouterr().err == (
        f"error: {tmp_path / 'none'}: no such bag; give a bag's folder, or that of the run with it\n"
    )
    assert not list(tmp_path.iterdir())


def test_the_folder_of_a_run_stands_for_its_bag(tmp_path: Path) -> None:
    shutil.copytree(BAG, tmp_path / "run/bag")
    assert main(["bag", "analyse", str(tmp_path / "run"), "--out", str(tmp_path / "out")]) == 0
    assert main(["bag", "export", str(tmp_path / "run"), "--format", "csv", "--out", str(tmp_path / "a.csv")]) == 0
    assert main(["bag", "verify", str(tmp_path / "run")]) == 0
