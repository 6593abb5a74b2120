# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags with topics of other programs: a type of ROS that is not ours is a table, another encoding is left out."""

import struct
from pathlib import Path

import pytest
from exported import BAG
from mcap.reader import make_reader
from mcap.writer import Writer

from atpid_control.runs.run import open_run

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
    tree, whole = open_run(with_topic(tmp_path / "run", *FOREIGN[name])).tree(), open_run(BAG).tree()
    assert {node.path for node in tree.leaves} == {node.path for node in whole.leaves}
    assert tree["sensors/laser"].to_dataset().equals(whole["sensors/laser"].to_dataset())
    (line,) = tree.attrs["missing"]
    why = "without a definition in ros2msg" if name == "idl" else f"encoded as '{FOREIGN[name][0]}'"
    assert line.startswith(f"{tmp_path / 'run'}: /foreign: left out, {why}")


def test_a_type_of_another_package_is_a_table_with_units(tmp_path: Path) -> None:
    data = b"\0\1\0\0" + struct.pack("<dII2s", 293.15, 1, 2, b"x\0")
    tree = open_run(with_topic(tmp_path / "run", "cdr", "ros2msg", OWN, data)).tree()
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
            channel = writer.register_channel(
                "/lab", "cdr", writer.register_schema("lab/msg/Thing", "ros2msg", definition)
            )
            writer.add_message(channel, number, b"\0\1\0\0" + struct.pack("<d", value) * (number + 1), number)
        writer.finish()  # type: ignore[no-untyped-call]
    tree = open_run(tmp_path).tree()
    first, second = (tree[name].to_dataset() for name in ("lab", "lab_definition_2"))
    assert (first["a"].item(), "b" in first) == (1.5, False)
    assert (second["a"].item(), second["b"].item(), second["b"].attrs["units"]) == (2.5, 2.5, "s")


@pytest.mark.parametrize(("topic", "place"), [("/sensors", "sensors/messages"), ("/../x", "_/x"), ("/", "_")])
def test_a_topic_above_others_or_with_no_name_has_its_place(topic: str, place: str, tmp_path: Path) -> None:
    tree = open_run(with_topic(tmp_path / "run", "cdr", "ros2msg", OWN, b"\0\1\0\0" + bytes(12), topic)).tree()
    assert tree[place]["temperature"].item() == 0.0
    assert tree["sensors/laser"].sizes["time"] > 1
    assert set(open_run(tmp_path / "run").frames()) == {node.path.strip("/") for node in tree.leaves}
