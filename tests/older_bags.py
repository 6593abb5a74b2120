# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags with older message definitions, made from one with today's: fields are taken out or renamed."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.runs.parts import find_parts
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import records

Change = Callable[[str], str]


def without_handshake(definition: str) -> str:
    """Return the definition as it was before messages had the field `handshake`."""
    return "\n".join(line for line in definition.splitlines() if not line.startswith("bool handshake"))


def older(bag: Path, folder: Path, change: Change = without_handshake, files: dict[str, bytes] | None = None) -> Path:
    """Write `bag` to `folder` with the definitions that `change` returns; `files` replaces those kept in it."""
    shutil.copytree(bag, folder)
    file, opened = find_parts(bag)[0], open_bag(bag)
    store = get_typestore(Stores.EMPTY)
    names: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    made: dict[int, int] = {}
    with find_parts(folder)[0].open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        for record in records(file):
            if isinstance(record, Header):
                writer.start(profile=record.profile, library=record.library)
            elif isinstance(record, Schema) and record.id not in names:
                text = change(record.data.decode())
                found = get_types_from_msg(text, record.name)
                store.register({name: fields for name, fields in found.items() if name not in store.fielddefs})
                names[record.id] = record.name
                made[record.id] = writer.register_schema(record.name, record.encoding, text.encode())
            elif isinstance(record, Channel) and record.id not in channels:
                channels[record.id] = record
                described = record.metadata | {"topic_type_hash": f"RIHS01_{'0' * 64}"}
                writer.register_channel(record.topic, "cdr", made[record.schema_id], described)
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                message = opened.decoder.decode(channel.schema_id, record.data)
                name = names[channel.schema_id]
                data = store.serialize_cdr(_filled(store, name, message), name)
                writer.add_message(record.channel_id, record.log_time, bytes(data), record.publish_time)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Attachment) and files is None:
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        for name, content in (files or {}).items():
            writer.add_attachment(0, 0, name, "application/octet-stream", content)
        writer.finish()  # type: ignore[no-untyped-call]
    return folder


def _filled(store: Any, name: str, message: Any) -> Any:
    values = {}
    for field, (kind, described) in store.fielddefs[name][1]:
        value = getattr(message, field, 0)
        if kind == Nodetype.NAME:
            value = _filled(store, described, value)
        elif described[0] == "string":
            value = str(value)
        values[field] = value
    return store.types[name](**values)


def with_parameters(bag: Path, **changes: Any) -> dict[str, bytes]:
    """Return the files kept in `bag`, with parameters of selector_node changed; None takes one out."""
    kept = dict(open_bag(bag).files)
    document = yaml.safe_load(kept["parameters.yaml"])
    (block,) = (entry["ros__parameters"] for key, entry in document.items() if key.endswith("selector_node"))
    block.update(changes)
    for name in [name for name, value in changes.items() if value is None]:
        del block[name]
    kept["parameters.yaml"] = yaml.safe_dump(document).encode()
    return kept
