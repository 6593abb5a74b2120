# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a bag must hold for `ros2 bag` and public libraries to open it, and what is left of one after a crash."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_files import BAG
from mcap.reader import make_reader
from mcap.writer import Writer
from recorded import LASER, Capture, begin_bag, block, in_one_line, make, record, refused, short, write_bag
from rosbags.highlevel import AnyReader

from atpid_control.cli import main
from atpid_control.recording.session import StampOrder
from atpid_control.runs.decode import is_handshake, message_type
from atpid_control.runs.errors import BagError, TypeUnknownError
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import repair
from atpid_control.runs.topics import DEFAULT, TRUTH, block_shape, event, parse, shape_of, stamp
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter, Sink

BLOCK = "atpid_interfaces/msg/SampleBlock"
BLOCKS = 40


def blocks_of_noise(count: int = BLOCKS) -> list[tuple[str, bytes]]:
    noise = np.random.default_rng(1)
    return [(LASER, block(50 * number, noise.normal(size=(50, 2)))) for number in range(count)]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    return record(folder / "run", short(folder, 2.0), [(0.8, 0.2, 0.01)])


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Return the file of a whole bag of noise."""
    return write_bag(tmp_path / "run", blocks_of_noise()) / "run_0.mcap"


def information_of(bag: Path) -> Any:
    return yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_metadata_yaml_holds_all_that_rosbag2_asks_for(bag: Path) -> None:
    information = information_of(bag)
    topics = information.pop("topics_with_message_count")
    custom = information.pop("custom_data")
    counts = {name: information[name] for name in ("starting_time", "duration", "message_count")}
    assert information == counts | {
        "version": 9,
        "storage_identifier": "mcap",
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["run_0.mcap"],
        "files": [{"path": "run_0.mcap", **counts}],
        "ros_distro": information["ros_distro"],
    }
    assert (bag / "run_0.mcap").is_file()
    assert custom["run_id"] == "specimen"
    assert counts["message_count"] == sum(entry["message_count"] for entry in topics)
    for entry in topics:
        topic = entry["topic_metadata"]
        assert (topic["serialization_format"], topic["type_description_hash"][:7]) == ("cdr", "RIHS01_")
        (profile,) = topic["offered_qos_profiles"]
        assert profile["deadline"] == profile["lifespan"] == {"sec": 9223372036, "nsec": 854775807}
        assert (profile["reliability"], profile["history"]) == ("reliable", "keep_last")


def test_the_file_is_what_rosbag2_calls_mcap(bag: Path) -> None:
    with (bag / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
            assert isinstance(channel.metadata["offered_qos_profiles"], str)
            assert channel.metadata["topic_type_hash"] == message_type(schema.name).hash
        assert all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
        # a chunk ends with the message that passes 16 KiB
        assert max(chunk.uncompressed_size for chunk in summary.chunk_indexes) < 16_384 + 4_096
        assert summary.statistics.message_count == verify(bag).messages
        (scene,) = [item for item in reader.iter_attachments() if item.name == "scene.yaml"]
        assert "mass_fraction" in scene.data.decode()
        assert {item.name: item.metadata for item in reader.iter_metadata()}["atpid_result"]["finished"] == "yes"


def test_in_lockstep_log_times_are_stamps_in_order(bag: Path) -> None:
    with (bag / "run_0.mcap").open("rb") as stream:
        messages = list(make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False))
    assert all(message.log_time == message.publish_time == stamp(message.data) for _, _, message in messages)
    assert all(a.log_time <= b.log_time for (_, _, a), (_, _, b) in pairwise(messages))
    for topic in {channel.topic for _, channel, _ in messages}:
        sequences = [message.sequence for _, channel, message in messages if channel.topic == topic]
        assert sequences == list(range(len(sequences)))


def test_public_readers_open_the_bag_without_the_workspace() -> None:
    """By the definitions inside it: mcap with mcap-ros2-support, which only this test needs, and rosbags."""
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is missing: make test-packages")
    expected = [message.data[1::2].tolist() for _, message in open_bag(BAG).messages(LASER)]
    with (BAG / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        decoded: list[Any] = [message for _, _, _, message in reader.iter_decoded_messages(topics=[LASER])]
    with AnyReader([BAG]) as other:
        chosen = [one for one in other.connections if one.topic == LASER]
        others: list[Any] = [other.deserialize(data, one.msgtype) for one, _, data in other.messages(chosen)]
    assert [list(block.data[1::2]) for block in decoded] == expected
    assert [list(block.data[1::2]) for block in others] == expected


def test_definition_names_every_type_inside() -> None:
    assert {"MSG: std_msgs/Header", "MSG: builtin_interfaces/Time"} <= set(message_type(BLOCK).definition.splitlines())
    assert message_type("atpid_interfaces/msg/Event").has_header  # its constants come before its header
    assert not message_type("rosgraph_msgs/msg/Clock").has_header


@pytest.mark.parametrize("name", ["SampleBlock", "atpid_interfaces/msg/Nothing", "no_such_package/msg/Thing"])
def test_unknown_types_are_refused_in_one_line(name: str) -> None:
    with pytest.raises(TypeUnknownError) as caught:
        message_type(name)
    in_one_line(caught.value, name.split("/")[-1])


def test_fields_are_read_in_place_whatever_the_alignment() -> None:
    for frame_id in ("", "a", "ab", "abc", "abcd", "plant:laser"):
        units = {"channels": ["a", "bcd"], "units": ["m", "m/s^2"], "skew": np.zeros(2), "data": np.arange(6.0)}
        data = make("SampleBlock", 12_345_678_901, "a device", frame_id, first_index=7, rate=1000.0, dropped=3, **units)
        assert stamp(data) == 12_345_678_901
        assert not is_handshake(data)
        assert is_handshake(make("SampleBlock", frame_id=frame_id, handshake=True))
        assert block_shape(data) == (7, 1000.0, 3)
        assert event(make("Event", 1, "n", frame_id, kind="finished", text="x")) == ("finished", "n")
        truth = make("PlantTruth", 1, frame_id=frame_id, first_index=9, rate=10.0, support=np.zeros(4))
        assert shape_of(TRUTH, truth) == (9, 10.0, 4)
    assert block_shape(make("SampleBlock", handshake=True, channels=["a"])).scans == 0


def test_order_is_by_stamp_topic_sender_and_arrival() -> None:
    order = StampOrder(["a", "b", "e"], {"a", "b"}, hold_back_ns=0)
    order.add("b", 10, "", b"b10")
    order.add("e", 10, "z", b"from z")
    order.add("e", 10, "y", b"from y, first")
    order.add("a", 10, "", b"a10")
    order.add("e", 10, "y", b"from y, then")
    assert not list(order.ready())
    order.add("a", 20, "", b"a20")
    order.add("b", 20, "", b"b20")
    assert [held.data for held in order.ready()] == [b"a10", b"b10", b"from y, first", b"from y, then", b"from z"]
    assert [held.data for held in order.rest()] == [b"a20", b"b20"]
    assert len(order) == 0


def test_what_is_paced_by_the_clock_stays_out_of_a_lockstep_bag() -> None:
    left_out = {topic.name for topic in parse(DEFAULT, lockstep=False)} - {topic.name for topic in parse(DEFAULT, True)}
    transitions = {f"{node}/transition_event" for node in ("motor_node", "excitation_node", "labjack_node", "ni_node")}
    assert left_out == {"/diagnostics", "/rosout", "supervisor/state"} | transitions


@pytest.mark.parametrize("entry", ["sensors/laser", f"a {BLOCK} sometimes", "a no_such/msg/Type"])
def test_topics_are_checked(entry: str) -> None:
    with pytest.raises(BagError):
        parse([entry], lockstep=False)


def test_an_existing_folder_is_never_written_over(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(BagError, match=r"run: .*exists"):
        BagWriter(tmp_path / "run", new_run())
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"file/run: .*folder"):
        BagWriter(tmp_path / "file" / "run", new_run())


def test_files_of_one_name_are_all_kept_and_one_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    for folder, text in {"a": "left", "b": "right", "c": "left"}.items():
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "motor.yaml").write_text(text)
    run = new_run(tmp_path / "a" / "motor.yaml", [tmp_path / folder / "motor.yaml" for folder in "abc"])
    assert run.files == {"scene.yaml": b"left", "motor.yaml": b"left", "motor-2.yaml": b"right"}
    with pytest.raises(BagError, match=r"missing\.yaml"):
        new_run(tmp_path / "missing.yaml")


def test_a_full_disk_is_one_line_and_the_rest_can_be_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = begin_bag(tmp_path / "run", blocks_of_noise())
    space = 5_000
    whole = Sink.write

    def limited(sink: Sink, data: bytes) -> int:
        nonlocal space
        whole(sink, data[:space])
        space -= len(data)
        if space < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return len(data)

    def fill() -> None:
        for number in range(BLOCKS, 100):
            writer.write(LASER, block(50 * number, np.zeros((50, 2))), number, number)

    with monkeypatch.context() as patched:
        patched.setattr(Sink, "write", limited)
        with pytest.raises(BagError) as caught:
            fill()
    in_one_line(caught.value, "full", "recover")
    writer.close()
    with pytest.raises(BagError, match="breaks off"):
        verify(tmp_path / "run")
    assert repair(tmp_path / "run").verified.messages >= 30


def test_a_kill_loses_at_most_one_chunk(tmp_path: Path) -> None:
    """The writer is not closed, and its files are unbuffered: what is in them is what a killed process leaves."""
    folder = tmp_path / "run"
    writer = begin_bag(folder, blocks_of_noise(400))
    assert not (folder / "metadata.yaml").exists()
    with pytest.raises(BagError, match="breaks off"):
        verify(folder)
    found = repair(folder).verified
    # a block of 50 x 2 doubles is about 1 kB, so that a chunk of 16 KiB holds 17 of them
    assert 400 - 17 <= found.messages <= 400
    assert repair(folder).verified == found
    assert (folder / "run_0.mcap.damaged").is_file()
    writer.close()


@pytest.mark.parametrize("end", [BagWriter.end_chunk, BagWriter.sync])
def test_what_came_before_an_ended_chunk_survives_a_crash(tmp_path: Path, end: Callable[[BagWriter], None]) -> None:
    writer = begin_bag(tmp_path / "run", blocks_of_noise())
    end(writer)
    size = writer.size
    writer.end_chunk()  # without messages
    assert writer.size == size
    assert repair(tmp_path / "run").verified.messages == BLOCKS
    information = information_of(tmp_path / "run")
    assert information["custom_data"]["run_id"] == "small"
    assert "repaired" in information["custom_data"]
    (topic,) = information["topics_with_message_count"]
    assert topic["topic_metadata"]["offered_qos_profiles"] == [Qos().mapping()]
    writer.close()


def test_a_changed_byte_is_noticed_wherever_it_is(small: Path) -> None:
    data = small.read_bytes()
    for place in range(0, len(data), 67):
        changed = bytearray(data)
        changed[place] ^= 1 << place % 8
        small.write_bytes(changed)
        with pytest.raises(BagError) as caught:
            verify(small.parent)
        in_one_line(caught.value)


def test_a_changed_attachment_is_noticed_in_a_bag_without_a_checksum_of_all(tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    with file.open("wb") as stream:
        other = Writer(stream)
        other.start(profile="ros2", library="another program")
        other.add_attachment(0, 0, "scene.yaml", "text/yaml", b"stiffness: 427.6")
        other.finish()  # type: ignore[no-untyped-call]
    file.write_bytes(file.read_bytes().replace(b"427.6", b"927.6"))
    with pytest.raises(BagError, match=r"scene\.yaml.*damaged"):
        verify(file)


def test_a_second_repair_keeps_what_the_first_has_kept(small: Path) -> None:
    for _ in range(2):
        data = small.read_bytes()
        small.write_bytes(data[: 2 * len(data) // 3])
        repair(small.parent)
    kept = sorted(path.name for path in small.parent.glob("*.damaged*"))
    assert kept == ["run_0.mcap.damaged", "run_0.mcap.damaged.2"]


def test_metadata_that_contradicts_the_file_is_detected_and_repaired(small: Path) -> None:
    path = small.parent / "metadata.yaml"
    path.write_text(path.read_text().replace("message_count: 40", "message_count: 39"))
    with pytest.raises(BagError, match=r"39 .*/sensors/laser.* 40"):
        verify(small.parent)
    assert repair(small.parent).verified.messages == BLOCKS


@pytest.mark.parametrize("action", ["check", "repair"])
def test_what_is_no_bag_is_one_line(action: str, tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "empty").mkdir()
    text = tmp_path / "text.mcap"
    text.write_text("not a bag\n")
    nothing = tmp_path / "nothing" / "run_0.mcap"
    nothing.parent.mkdir()
    nothing.touch()
    for given in (tmp_path / "missing", tmp_path / "empty", text, nothing, nothing.parent):
        refused(capsys, ["bag", action, given], str(given))
    with pytest.raises(BagError):
        verify(tmp_path / ("a" * 5000))


def test_what_a_bag_keeps_can_be_taken_out(bag: Path, tmp_path: Path, capsys: Capture) -> None:
    extract = ["bag", "extract", bag, "--out", tmp_path / "kept"]
    assert main([str(word) for word in extract]) == 0
    assert (tmp_path / "kept" / "scene.yaml").read_text() == (bag.parent / "short.yaml").read_text()
    refused(capsys, extract)
    refused(capsys, ["bag", "extract", write_bag(tmp_path / "bare", blocks_of_noise()), "--out", tmp_path])


def test_reading_needs_no_ros(bag: Path) -> None:
    hidden = ("rclpy", "ament_index_python", "atpid_interfaces", "std_msgs", "builtin_interfaces")
    code = f"import sys; sys.modules |= dict.fromkeys({hidden}); from atpid_control.runs.run import open_run; "
    code += f"assert len(open_run({str(bag)!r}).estimates.time) == 40"
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("AMENT_", "ROS_"))}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
