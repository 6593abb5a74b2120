# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag in sqlite3, rosbag2's other storage, as the records an MCAP file would have."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from mcap.records import Channel, DataEnd, Footer, Header, McapRecord, Message, Schema
from rosbags.typesys import Stores, get_typestore

from atpid_control.runs.definitions import message_type
from atpid_control.runs.errors import BagError

#: What a database begins with, and what rosbag2's ends with.
MAGIC, ENDING = b"SQLite format 3\0", ".db3"


#: Advice for one that is damaged.
NO_RECOVERY = "`.recover` of the program sqlite3 saves what is whole"


def sqlite_records(file: Path) -> Iterator[McapRecord]:
    """Yield the topics of a file and their messages in the order of their times. Raises sqlite3.Error: damaged."""
    with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as database:
        database.row_factory = sqlite3.Row
        tables = {row["name"] for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise ValueError(f"tables {', '.join(sorted(tables)) or 'none'}; needed: topics and messages, as rosbag2's")
        kept = {}
        if "message_definitions" in tables:
            kept = {row["topic_type"]: (row["encoding"], row["encoded_message_definition"])
                    for row in database.execute("SELECT * FROM message_definitions")}  # fmt: skip
        yield Header(profile="ros2", library="rosbag2, in sqlite3")
        schemas: dict[str, int] = {}
        for topic in database.execute("SELECT * FROM topics ORDER BY id").fetchall():
            kind = topic["type"]
            if kind not in schemas:
                schemas[kind] = len(schemas) + 1
                encoding, definition = kept.get(kind) or ("", "")
                if not definition:
                    definition = definition_elsewhere(kind)
                    encoding = "ros2msg" if definition else "none"
                yield Schema(id=schemas[kind], name=kind, encoding=encoding, data=definition.encode())
            known = {"topic_type_hash": dict(topic).get("type_description_hash", "")}  # an older bag has none
            yield Channel(id=topic["id"], topic=topic["name"], message_encoding=topic["serialization_format"],
                          schema_id=schemas[kind], metadata=known)  # fmt: skip
        counts: dict[int, int] = {}
        for row in database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"):
            number = counts[row["topic_id"]] = counts.get(row["topic_id"], -1) + 1
            yield Message(channel_id=row["topic_id"], log_time=row["timestamp"], publish_time=row["timestamp"],
                          data=bytes(row["data"]), sequence=number)  # fmt: skip
    yield DataEnd(data_section_crc=0)
    yield Footer(summary_start=0, summary_offset_start=0, summary_crc=0)


def definition_elsewhere(kind: str) -> str:
    """Return the definition of a message type that an older bag does not keep: as installed, else as in ROS 2 Jazzy.

    Empty where neither has it; its topics are then left out, and named so.
    """
    try:
        return message_type(kind).definition
    except (BagError, ImportError):  # not installed, or no workspace is active
        pass
    store = get_typestore(Stores.ROS2_JAZZY)
    return str(store.generate_msgdef(kind, ros_version=2)[0]) if kind in store.fielddefs else ""
