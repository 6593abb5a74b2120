# SPDX-License-Identifier: Apache-2.0
"""Bags with topics of other programs: a type of ROS that is not ours is a table, another encoding is left out."""

import struct
from pathlib import Path

import pytest
from exported import BAG
from mcap.reader import make_reader
from mcap.writer import Writer

from atpid_control.export import frames, open_bag

OWN = b"float64 temperature # [K] of the room\nstring[] names\n"
#: Encoding of the message, that of its definition, the definition, a message.
FOREIGN = {
    "json": ("json", "jsonschema", b'{"type": "object"}', b'{"a": 1}'),
    "idl": ("cdr", "ros2idl", b"module lab { struct Thing { double a; }; };", b"\0\1\0\0" + struct.pack("<d", 1.5)),
    "without definition": ("json", "", b"", b'{"a": 1}'),
}


def with_topic(
    folder: Path, encoding: str, schema_encoding: str, definition: bytes, data: bytes, topic: str = "/foreign"
) -> Path:
    """Write the recorded bag with one more topic before its own."""
    folder.mkdir()
    with (folder / "bag_0.mcap").open("wb") as target, (BAG / "bag_0.mcap").open("rb") as source:
        writer, reader, ids = Writer(target), make_reader(source), dict[int, int]()
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("lab/msg/Thing", schema_encoding, definition) if definition else 0
        channel = writer.register_channel(topic, encoding, schema)
        writer.add_message(channel, 0, data, 0)
        for kind, own, message in reader.iter_messages():
            assert kind is not None
            if own.id not in ids:
                number = writer.register_schema(kind.name, kind.encoding, kind.data)
                ids[own.id] = writer.register_channel(own.topic, own.message_encoding, number)
            writer.add_message(ids[own.id], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    return folder


@pytest.mark.parametrize("name", list(FOREIGN))
def test_another_encoding_is_left_out_and_stated(name: str, tmp_path: Path) -> None:
    tree, whole = open_bag(with_topic(tmp_path / "run", *FOREIGN[name])), open_bag(BAG)
    assert {node.path for node in tree.leaves} == {node.path for node in whole.leaves}
    assert tree["sensors/laser"].to_dataset().equals(whole["sensors/laser"].to_dataset())
    (line,) = tree.attrs["missing"]
    assert line.startswith(f"/foreign: left out, encoded as '{FOREIGN[name][0]}'")


def test_a_type_of_another_package_is_a_table_with_units(tmp_path: Path) -> None:
    data = b"\0\1\0\0" + struct.pack("<dII2s", 293.15, 1, 2, b"x\0")
    tree = open_bag(with_topic(tmp_path / "run", "cdr", "ros2msg", OWN, data))
    room = tree["foreign"].to_dataset()
    assert (room["temperature"].item(), room["temperature"].attrs["units"]) == (293.15, "K")
    assert room["names"].item() == '["x"]'
    assert tree.attrs["missing"] == []


@pytest.mark.parametrize(("topic", "place"), [("/sensors", "sensors/messages"), ("/../x", "_/x"), ("/", "_")])
def test_a_topic_above_others_or_with_no_name_has_its_place(topic: str, place: str, tmp_path: Path) -> None:
    tree = open_bag(with_topic(tmp_path / "run", "cdr", "ros2msg", OWN, b"\0\1\0\0" + bytes(12), topic))
    assert tree[place]["temperature"].item() == 0.0
    assert tree["sensors/laser"].sizes["time"] > 1
    assert set(frames(tmp_path / "run")) == {node.path.strip("/") for node in tree.leaves}
