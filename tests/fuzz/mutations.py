# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile files: good ones, changed as disks, editors and other programs change them, or as one who means harm does."""

from __future__ import annotations

import copy
import dataclasses
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

#: Pieces that parsers of text and of archives stumble over.
PIECES = [
    b"", b"\0", b"\n", b"\xff\xfe", b"\xef\xbb\xbf", b"nan", b"-inf", b"1e999", b"9" * 5000, b"-1", b"0", b",", b",,",
    b": ", b"- ", b"? [a]\n: b\n", b"&a [*a]", b"!!python/object/apply:os.system [true]", b"!!timestamp 2026-99-99",
    b"!!bool maybe", b"!!float ''", b"{", b"[" * 200, b"]" * 50, b"*a", b"<<: *a", b"%YAML 9.9\n", b"---\n", b"...\n",
    b"\xf0\x9f\x98\x80", b"\x80", b"\r", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\xff" * 8,
    b'"', b"0x7fffffffffffffff", b"1_0", b"yes", b"~", b"null", b"__import__('os')", b"../../x", b"/dev/zero",
]  # fmt: skip

#: Values in place of one value of a document.
VALUES: list[Any] = [
    None, True, False, 0, -1, 1, 2**63, -(2**63) - 1, 10**400, 0.0, -0.0, 1e-320, 1e308, -1e308, float("nan"),
    float("inf"), "", "x", "nan", "1e5", "resonance", "1,5", "\0", "../../etc/passwd", "/dev/zero",
    "x" * 5000, [], [[]], {}, [None],
    [1, "a", None], {"a": 1}, {"": {}}, [[0, 1e308], [1, -1e308]], [[1, 0], [0, 0]], [0.0] * 1000,
]  # fmt: skip


@st.composite
def changed_bytes(draw: st.DrawFn, seeds: Sequence[bytes]) -> bytes:
    """Return one of the seeds with some ranges removed, repeated, replaced or cut."""
    data = bytearray(draw(st.sampled_from(list(seeds))))
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, max(0, len(data) - 1)))
        length = draw(st.sampled_from([0, 1, 2, 4, 8, 50, 1000]))
        act = draw(st.sampled_from(["put", "replace", "repeat", "remove", "cut", "bit"]))
        piece = draw(st.sampled_from(PIECES) | st.binary(max_size=8))
        if act == "put":
            data[begin:begin] = piece
        elif act == "replace":
            data[begin : begin + len(piece)] = piece
        elif act == "repeat":
            data[begin:begin] = bytes(data[begin : begin + length]) * draw(st.sampled_from([1, 2, 100]))
        elif act == "remove":
            del data[begin : begin + length]
        elif act == "cut":
            del data[begin:]
        elif data:
            data[begin] ^= 1 << draw(st.integers(0, 7))
    return bytes(data)


@st.composite
def changed_document(draw: st.DrawFn, seeds: Sequence[Any]) -> Any:
    """Return one of the documents with some of its values, at any depth, replaced, removed or added."""
    document = yaml.safe_load(yaml.safe_dump(draw(st.sampled_from(list(seeds)))))
    for _ in range(draw(st.integers(1, 3))):
        holder: Any = None
        key: Any = None
        value = document
        while isinstance(value, (dict, list)) and value and (holder is None or draw(st.integers(0, 3))):
            holder = value
            key = draw(st.sampled_from(sorted(value, key=str) if isinstance(value, dict) else range(len(value))))
            value = value[key]
        new = copy.deepcopy(draw(st.sampled_from(VALUES) | st.floats() | st.text(max_size=10)))  # changed in turn
        if holder is None:
            return new
        act = draw(st.sampled_from(["value", "value", "value", "remove", "add", "wrap"]))
        if act == "remove":
            del holder[key]
        elif act == "add" and isinstance(holder, dict):
            holder[draw(st.text(max_size=5))] = new
        else:
            holder[key] = [value] if act == "wrap" else new
    return document


def as_yaml(document: Any) -> bytes:
    """Return a document as YAML."""
    text: str = yaml.safe_dump(document, allow_unicode=True)
    return text.encode("utf-8", "surrogatepass")


@st.composite
def changed_arrays(draw: st.DrawFn, seed: dict[str, Any]) -> bytes:
    """Return an NPZ archive of the arrays, some of them of another shape, kind or content, or missing."""
    arrays = dict(seed)
    for _ in range(draw(st.integers(1, 3))):
        if not arrays:
            break
        name = draw(st.sampled_from(sorted(arrays)))
        array = np.asarray(arrays[name])
        act = draw(st.sampled_from(["one", "all", "shape", "kind", "remove", "cut", "text", "add"]))
        value = draw(st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -1.0, 1e308, 1e6, 1e-300, 5e-324]))
        if act == "one" and array.size and array.dtype.kind == "f":
            array = array.copy()
            with np.errstate(over="ignore"):
                array.flat[draw(st.integers(0, array.size - 1))] = value
        elif act == "all":
            array = np.full_like(array, value) if array.dtype.kind == "f" else np.full(array.shape, value)
        elif act == "shape":
            array = draw(st.sampled_from([array.ravel(), array[None], np.zeros(()), np.zeros((0, 0)), array.T]))
        elif act == "kind":
            kind = draw(st.sampled_from(["c16", "U5", "M8[s]", "?", "i1", "S3", "f2", "u8"]))
            with np.errstate(all="ignore"):
                array = array.astype(kind) if array.dtype.kind in "fib" and kind[0] not in "MUS" else np.zeros(3, kind)
        elif act == "remove":
            del arrays[name]
            continue
        elif act == "cut":
            array = array[..., : draw(st.integers(0, 3))] if array.ndim else array
        elif act == "text":
            texts = ["", "{", "[]", "null", '{"format": 1}', "[" * 3000, "9" * 5000, str(array)[:-5]]
            array = np.array(draw(st.sampled_from(texts)))
        else:
            name = draw(st.sampled_from(["x", "../x", "", "a/b", "about"]))
        arrays[name] = array
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def records_of(data: bytes, most: int) -> list[Any]:
    """Return the records of a bag, at most so many messages of each topic."""
    found: list[Any] = []
    counts: dict[int, int] = {}
    for record in StreamReader(io.BytesIO(data)).records:
        if isinstance(record, Message):
            counts[record.channel_id] = counts.get(record.channel_id, 0) + 1
            if counts[record.channel_id] > most:
                continue
        if isinstance(record, (Schema, Channel, Message, Attachment, Metadata)):
            found.append(record)
    return found


def bag_of(records: Sequence[Any], chunk: int = 100_000) -> bytes:
    """Return records as an MCAP file whose lengths, checksums and index are right, whatever is in the records."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="ros2", library="")
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for record in records:
        if isinstance(record, Schema):
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas.get(record.schema_id, record.schema_id), record.metadata
            )
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id, record.channel_id)
            writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


@st.composite
def changed_bag(draw: st.DrawFn, records: Sequence[Any]) -> bytes:
    """Return a bag of the records, sound as a file, with what is in some of them changed, and some left out."""
    made = list(records)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(made) - 1))
        old = made[place]
        act = draw(st.sampled_from(["change", "change", "change", "remove", "repeat"]))
        if act == "remove" and len(made) > 1 and not isinstance(old, (Schema, Channel)):
            del made[place]
        elif act == "repeat":
            made.insert(place, old)
        else:
            name = draw(st.sampled_from([field.name for field in dataclasses.fields(old)]))
            made[place] = dataclasses.replace(old, **{name: draw(_other(name, getattr(old, name)))})
    return bag_of(made)


def _other(name: str, old: Any) -> st.SearchStrategy[Any]:
    """Return what a field of a record may have in place of its value."""
    if isinstance(old, bytes):
        return changed_bytes([old])
    if isinstance(old, str):
        others = ["", "\0", "../../x", "/", "a/b", "x" * 300, old + "x", old.upper(), "ü", "json", "protobuf"]
        return st.sampled_from(others)
    if isinstance(old, dict):
        return st.sampled_from([{}, {"offered_qos_profiles": "["}, {"topic_type_hash": "\0"}, dict.fromkeys(old, "")])
    return st.sampled_from([0, 2**63, 2**64 - 1] if name.endswith("time") else [0, 1, 65535])
