# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whole bags made from a recorded one, some of whose messages are changed, as another recorder may write them."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.runs.records import records

BAG = Path(__file__).parents[2] / "bags/thesis_4_3_short"
#: Takes the topic, the place of a message in it and the message, which it changes; False: the message is left out.
Change = Callable[[str, int, Any], bool | None]


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
        blocks = ("/sensors/laser", "/plant/truth") if truth else ("/sensors/laser",)
        if topic in blocks and at <= place < at + length:
            message.first_index += ahead

    return change
