# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recorded bag, bags made from it whose messages are changed, and one with two rates, lost samples and an event."""

from collections import Counter
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer
from recorded import EVENTS, LASER, begin_bag, block, make
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.cli import main
from atpid_control.runs.records import records

ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags/thesis_4_3_short"
SUPPORT, BEAM = "support_displacement", "beam_displacement"
RATE, SLOW = 1000.0, 320.0
START = 1_700_000_000_000_000_000
LOST = (200, 60)  # first index, how many
TEXT = '60 lost, "here" #1'
#: pandas reads floats to the last digit by default from version 3 on.
EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
#: A definition and a message of it, of another program.
OWN = b"float64 temperature # [K] of the room\nstring[] names\n"
EMPTY = b"\0\1\0\0" + bytes(12)

#: Takes the topic, the place of a message in it and the message, which it changes; False: the message is left out.
Change = Callable[[str, int, Any], bool | None]


def samples(index: Any, channels: int = 2) -> Any:
    """Return values (n, channels) whose last digits matter."""
    return np.sin(np.outer(index, np.arange(1, channels + 1)) * 0.1) / 3.0


def written(folder: Path, blocks: int = 10, size: int = 50) -> Path:
    """Write a bag of two rates: samples lost by index in the laser, an invalid one, an event, and estimates."""
    writer = begin_bag(folder, topics=(LASER, "/sensors/force", "/excitation", EVENTS), run_id="numbers")
    for number in range(blocks):
        first = number * size + (LOST[1] if number * size >= LOST[0] else 0)
        data = samples(first + np.arange(size))
        if number == 1:
            data[7, 1] = np.nan
        at = START + round(first / RATE * 1e9)
        writer.write(LASER, block(first, data, RATE, START), at, at)
        told = {"channels": ["force"], "units": ["N"], "skew": np.array([1e-5])}
        force = block(number * 16, samples(number * 16 + np.arange(16), 1), SLOW, START, **told)
        writer.write("/sensors/force", force, at + 1, at + 1)
        estimate = make("Excitation", at + 2, "identifier", quality=1, amplitude=0.01 / 3.0, frequency=5.5, used=number)
        writer.write("/excitation", estimate, at + 3_000_000, at + 2)
    event = make("Event", START + 5, "recorder_node", severity=1, kind="dropped", value=60.0, text=TEXT)
    writer.write(EVENTS, event, START + 5, START + 5)
    writer.close({"finished": "yes"})
    return folder


def expected(channel: int) -> Any:
    """Return the laser's channel as it must come out: lost and invalid samples are NaN."""
    values = samples(np.arange(10 * 50 + LOST[1]))[:, channel]
    values[LOST[0] : LOST[0] + LOST[1]] = np.nan
    if channel == 1:
        values[57] = np.nan
    return values


def exported(bag: Path, form: str, out: Path, *more: str) -> Path:
    """Export a bag; return the file."""
    assert main(["bag", "export", str(bag), "--format", form, "--out", str(out), *more]) == 0
    return out


def without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the commands that read bags draw nothing, and simulate no stage again."""
    for command in ("atpid_control.commands.analyse", "atpid_lab.comparison", "atpid_lab.validation"):
        monkeypatch.setattr(f"{command}.panels", lambda *_: ())
    monkeypatch.setattr("atpid_control.views.report.page.save_pictures", lambda *_: [])
    without_repetition(monkeypatch)


def without_repetition(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no stage of a run be simulated again to see whether it repeats."""
    stages = import_module("atpid_control.views.report.stages")
    monkeypatch.setattr(stages, "repeated", lambda _run, windows: [None] * len(windows))


def with_topic(
    folder: Path, definition: bytes = OWN, data: bytes = EMPTY, topic: str = "/foreign",
    encodings: tuple[str, str] = ("cdr", "ros2msg"),
) -> Path:  # fmt: skip
    """Write the recorded bag, without our own records, with a topic of another program before its own."""
    folder.mkdir()
    with (folder / "bag_0.mcap").open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2", library="libmcap 1.4.0")
        # the numbers of its own schemas and channels begin with 1
        kept = list(records(BAG / "bag_0.mcap"))
        for schema in {one.id: one for one in kept if isinstance(one, Schema)}.values():
            writer.register_schema(schema.name, schema.encoding, schema.data)
        for channel in {one.id: one for one in kept if isinstance(one, Channel)}.values():
            writer.register_channel(channel.topic, "cdr", channel.schema_id, channel.metadata)
        other = writer.register_schema("lab/msg/Thing", encodings[1], definition) if definition else 0
        writer.add_message(writer.register_channel(topic, encodings[0], other), 0, data, 0)
        for message in kept:
            if isinstance(message, Message):
                writer.add_message(message.channel_id, message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    return folder


def rewritten(folder: Path, change: Change, source: Path = BAG) -> Path:
    """Write the bag `source`, of one file, into `folder` with its messages changed; return the folder."""
    (file,) = source.glob("*.mcap")
    folder.mkdir(parents=True)
    stores, topics, counts, kept = dict[int, tuple[Any, str]](), dict[int, Channel](), Counter[str](), Counter[str]()
    with (folder / file.name).open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 16)
        writer.start(profile="ros2", library="test")
        for record in records(file):
            if isinstance(record, Schema) and record.id not in stores:
                writer.register_schema(record.name, record.encoding, record.data)
                stores[record.id] = get_typestore(Stores.EMPTY), record.name
                stores[record.id][0].register(get_types_from_msg(record.data.decode(), record.name))
            elif isinstance(record, Channel) and record.id not in topics:
                writer.register_channel(record.topic, record.message_encoding, record.schema_id, record.metadata)
                topics[record.id] = record
            elif isinstance(record, Message):
                topic = topics[record.channel_id].topic
                store, name = stores[topics[record.channel_id].schema_id]
                message = store.deserialize_cdr(record.data, name)
                use = change(topic, counts[topic], message) is not False
                counts[topic] += 1
                if use:
                    data = bytes(store.serialize_cdr(message, name))
                    writer.add_message(record.channel_id, record.log_time, data, record.publish_time, kept[topic])
                    kept[topic] += 1
            elif isinstance(record, Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
        writer.finish()  # type: ignore[no-untyped-call]
    about = yaml.safe_load((source / "metadata.yaml").read_text(encoding="utf-8"))
    listed = about["rosbag2_bagfile_information"]
    for entry in listed["topics_with_message_count"]:
        entry["message_count"] = kept[entry["topic_metadata"]["name"]]
    listed["message_count"] = listed["files"][0]["message_count"] = kept.total()
    (folder / "metadata.yaml").write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")
    return folder


def jumps(at: int, ahead: int, *, length: int = 1 << 62, truth: bool = True) -> Change:
    """Return a change: the indices of `length` blocks from number `at` on are `ahead` scans further, or back."""

    def change(topic: str, place: int, message: Any) -> None:
        blocks = (LASER, "/plant/truth") if truth else (LASER,)
        if topic in blocks and at <= place < at + length:
            message.first_index += ahead

    return change
