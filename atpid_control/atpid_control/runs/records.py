# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The records of a file of a bag, MCAP or sqlite3, read in one pass with every checksum checked and no length believed.

A length is compared with what is left of the file before memory is taken for it, the size of a chunk when unpacked
with a limit, and records inside a chunk are made one by one.
"""

import sqlite3
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, suppress
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from rosbags.typesys import Stores, get_typestore

from atpid_control.runs.decode import message_type
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import SQLITE

#: Largest chunk when unpacked [bytes]; those of rosbag2 have 0.8 MB, ours 16 kB.
LARGEST_CHUNK = 2**28
#: What a compressed message begins with; plain CDR begins with 0.
_ZSTD = b"\x28\xb5\x2f\xfd"
#: What a byte of LZ4 unpacks to at most [bytes].
_LZ4 = 255
#: Ids of a file of a split bag begin at its place times this: MCAP's own have 16 bits.
IDS = 2**16
_CRC_SIZE, _FOOTER_SIZE, _RECORD_HEAD = 4, 29, 9  # [bytes]


class BoundedFile:
    """A file that refuses to read beyond its end, before memory is taken for it."""

    def __init__(self, stream: BinaryIO) -> None:
        """Take an open file; it is read from its beginning."""
        self._stream = stream
        self.size = stream.seek(0, SEEK_END)
        stream.seek(0)
        #: As a file does; it can be sought, so that the index can be used.
        self.seek, self.tell, self.seekable = stream.seek, stream.tell, stream.seekable

    def read(self, length: int = -1) -> bytes:
        """Return exactly `length` bytes, or the rest; raise ValueError where there are not as many."""
        place = self.tell()
        if length > max(0, self.size - place):
            raise ValueError(f"{length} bytes are needed from byte {place} on, and the file ends at {self.size}")
        return self._stream.read(length)


def renumbered(record: McapRecord, place: int) -> McapRecord:
    """Return `record` with ids that no other file of the bag has; those of the first file stay."""
    if isinstance(record, (Schema, Channel)):
        record.id += place * IDS
    if isinstance(record, Channel) and record.schema_id:
        record.schema_id += place * IDS
    if isinstance(record, Message):
        record.channel_id += place * IDS
    return record


def channel_of(message: Message, channels: Mapping[int, Channel]) -> Channel:
    """Return the channel of a message; raise BagError where the bag does not have it."""
    if message.channel_id not in channels:
        raise BagError(f"a message is of channel {message.channel_id}, which the bag does not have: it is damaged")
    return channels[message.channel_id]


def records(file: Path, torn_ok: bool = False) -> Iterator[McapRecord]:
    """Yield the records of a file with all checksums checked.

    A file that breaks off raises BagError, or just ends with `torn_ok`: one that is still being written.
    """
    with file.open("rb") as stream:
        in_sqlite = stream.read(len(SQLITE)) == SQLITE
        try:
            yield from plain(_sqlite_records(file) if in_sqlite else _records(BoundedFile(stream), torn_ok))
        except GeneratorExit:
            raise
        except Exception as error:  # the library raises many types of errors for damaged bytes
            if torn_ok:
                return
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            advice = NO_RECOVERY if in_sqlite else f"`atpid bag recover {file.parent}` saves what is whole"
            raise BagError(f"{file}: the bag breaks off or is damaged ({reason}); {advice}") from None


def _records(stream: BoundedFile, torn_ok: bool) -> Iterator[McapRecord]:
    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=stream.size)  # type: ignore[arg-type]
    for record in reader.records:
        if isinstance(record, Chunk):
            yield from inside(unpacked(record))
            continue
        if isinstance(record, Attachment) and not _attachment_whole(stream, record):
            if torn_ok:
                continue
            raise ValueError(f"the attachment {record.name} is damaged")
        if isinstance(record, Footer) and not torn_ok:
            _check_summary(stream, record)
        yield record


def unpacked(chunk: Chunk) -> bytes:
    """Return the contents of a chunk; raise ValueError where they are not those that were written, or too many."""
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes; at most {LARGEST_CHUNK}")
    if chunk.compression == "zstd":
        try:
            data = _unpacked_zstd(chunk.data, size)
        except zstandard.ZstdError:
            raise ValueError("a chunk cannot be unpacked") from None
    elif chunk.compression == "lz4":
        if len(chunk.data) * _LZ4 > LARGEST_CHUNK:
            raise ValueError(f"an LZ4 chunk of {len(chunk.data)} bytes; at most {LARGEST_CHUNK // _LZ4}")
        stream, length = get_chunk_data_stream(chunk)
        data = stream.read(length)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"a chunk compressed by {chunk.compression[:20]!r}; allowed: zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"a chunk does not unpack to the {size} bytes it states")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk does not have its checksum")
    return data


def _unpacked_zstd(data: bytes, most: int) -> bytes:
    """Return a frame's contents, up to a byte beyond `most`: it may state more, which would take the memory."""
    return zstandard.ZstdDecompressor().stream_reader(data).read(most + 1)


def plain(found: Iterable[McapRecord]) -> Iterator[McapRecord]:
    """Yield records, of messages that rosbag2 has compressed one by one the contents; one that is damaged stays."""
    for record in found:
        if isinstance(record, Message) and record.data[: len(_ZSTD)] == _ZSTD:
            with suppress(zstandard.ZstdError):
                record.data = _unpacked_zstd(record.data, LARGEST_CHUNK)
        yield record


def inside(data: bytes) -> Iterator[McapRecord]:
    """Yield the records of a chunk's contents one by one; raise ValueError where one is longer than what is left."""
    stream = ReadDataStream(BytesIO(data))
    while stream.count < len(data):
        opcode, length = struct.unpack("<BQ", _exactly(stream, _RECORD_HEAD))
        content = ReadDataStream(BytesIO(_exactly(stream, length)))
        if opcode == Opcode.MESSAGE:
            yield Message.read(content, length)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(content)
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(content)


def _exactly(stream: ReadDataStream, length: int) -> bytes:
    data = stream.read(length)
    if len(data) != length:
        raise ValueError(f"a record of {length} bytes in a chunk with {len(data)} left")
    return data


def _attachment_whole(stream: BoundedFile, record: Attachment) -> bool:
    """Whether the checksum that ends an attachment, which has just been read, is that of its contents; 0: has none."""
    stream.seek(-_CRC_SIZE, 1)
    stored, written = stream.read(_CRC_SIZE), RecordBuilder()
    record.write(written)
    computed = bytes(written.end())[-_CRC_SIZE:]  # type: ignore[no-untyped-call]
    return stored in (bytes(_CRC_SIZE), computed)


def _check_summary(stream: BoundedFile, footer: Footer) -> None:
    """Raise ValueError where the checksum of index and footer, which has just been read, is not theirs; 0: has none."""
    end = stream.tell()
    begin = footer.summary_start or end - _FOOTER_SIZE
    if footer.summary_crc and begin < end:
        stream.seek(begin)
        if zlib.crc32(stream.read(end - begin)[:-_CRC_SIZE]) != footer.summary_crc:
            raise ValueError("its index is damaged")


#: Advice for a bag in sqlite3 that is damaged.
NO_RECOVERY = "`.recover` of the program sqlite3 saves what is whole"


def _sqlite_records(file: Path) -> Iterator[McapRecord]:
    """Yield the topics of a file and their messages in the order of their times. Raises sqlite3.Error: damaged."""
    with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as database:
        database.row_factory = sqlite3.Row
        tables = {row["name"] for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise ValueError(f"tables {', '.join(sorted(tables)) or 'none'}; needed: topics and messages, as rosbag2's")
        kept = {}
        if "message_definitions" in tables:
            select = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            kept = {row[0]: (row[1], row[2]) for row in database.execute(select)}
        yield Header(profile="ros2", library="rosbag2, in sqlite3")
        schemas: dict[str, int] = {}
        for topic in database.execute("SELECT * FROM topics ORDER BY id").fetchall():
            kind = topic["type"]
            if kind not in schemas:
                schemas[kind] = len(schemas) + 1
                encoding, definition = kept.get(kind) or ("", "")
                if not definition:
                    definition = _definition_elsewhere(kind)
                    encoding = "ros2msg" if definition else "none"
                yield Schema(id=schemas[kind], name=kind, encoding=encoding, data=definition.encode())
            known = {"topic_type_hash": dict(topic).get("type_description_hash", "")}  # an older bag has none
            yield Channel(topic["id"], topic["name"], topic["serialization_format"], known, schemas[kind])
        counts = Counter[int]()
        for row in database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"):
            channel, time = row["topic_id"], row["timestamp"]
            counts[channel] += 1
            yield Message(channel, time, bytes(row["data"]), publish_time=time, sequence=counts[channel] - 1)
    yield DataEnd(data_section_crc=0)
    yield Footer(summary_start=0, summary_offset_start=0, summary_crc=0)


def _definition_elsewhere(kind: str) -> str:
    """Return the definition of a message type that an older bag does not keep: as installed, else as in ROS 2 Jazzy.

    Empty where neither has it; its topics are then left out, and named so.
    """
    try:
        return message_type(kind).definition
    except (BagError, ImportError):  # not installed, or no workspace is active
        pass
    store = get_typestore(Stores.ROS2_JAZZY)
    return str(store.generate_msgdef(kind, ros_version=2)[0]) if kind in store.fielddefs else ""
