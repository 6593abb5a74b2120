# SPDX-License-Identifier: Apache-2.0
"""Verifies a bag by reading every message, and repairs one that a crash left incomplete.

`mcap recover` may succeed on a file that cannot be read; here success means that every message was decoded.
"""

import sys
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from atpid_common.files import FileError, parse_yaml, read_text
from atpid_control.bags import metadata
from atpid_control.bags.decode import Decoder
from atpid_control.bags.errors import BagError, in_words
from atpid_control.bags.metadata import RESULT, RUN, BagSummary, TopicSummary
from atpid_control.bags.writer import CHUNK, LIBRARY

_MAGIC = b"\x89MCAP0\r\n"
_LARGEST_CHUNK = 2**28  # unpacked; a damaged length must not take the memory [bytes]
#: Longest metadata.yaml [bytes]; one of 30 topics has 10 kB.
_MOST_METADATA = 200_000
#: What a byte of LZ4 unpacks to at most [bytes].
_LZ4 = 255
_CRC_SIZE, _FOOTER_SIZE = 4, 29  # [bytes]


@dataclass(frozen=True)
class Verified:
    """What reading every message of a bag showed."""

    folder: Path
    messages: int
    by_topic: dict[str, int]
    size: int  # [bytes]
    start_ns: int
    end_ns: int


def find_file(path: Path) -> Path:
    """Return the MCAP file of the bag `path` (its folder or the file itself); raise BagError where there is none."""
    try:
        found = path.exists()
    except OSError as error:
        raise BagError(f"{path}: cannot be opened ({error.strerror}); give a bag's folder") from None
    if not found:
        raise BagError(f"{path}: no such bag; give the folder that `ros2 bag` or recorder_node made")
    files = [path] if path.is_file() else sorted(path.glob("*.mcap"))
    if not files:
        raise BagError(
            f"{path}: not a bag, there is no .mcap file in this folder; give the folder that recorder_node made"
        )
    if len(files) > 1:
        raise BagError(
            f"{path}: {len(files)} .mcap files in this folder, a bag here has one; `ros2 bag convert` joins split bags"
        )
    try:
        with files[0].open("rb") as stream:
            magic = stream.read(len(_MAGIC))
    except OSError as error:
        raise BagError(f"{files[0]}: cannot be read ({error.strerror}); give a bag that can") from None
    if magic != _MAGIC:
        raise BagError(
            f"{files[0]}: not a bag (it does not begin as an MCAP file does); give the folder that recorder_node made"
        )
    return files[0]


def records(file: Path, torn_ok: bool = False) -> Iterator[McapRecord]:
    """Yield the records of an MCAP file with all checksums checked.

    A file that breaks off raises BagError, or just ends with `torn_ok`; a damaged attachment is then left out.
    """
    with file.open("rb") as stream:
        try:
            yield from _records(stream, file.stat().st_size, torn_ok)
        except Exception as error:  # the library raises many types of errors for damaged bytes
            if torn_ok:
                return
            reason = str(error) or type(error).__name__
            advice = f"`python -m atpid_control.recording repair {file.parent}` saves what is whole"
            raise BagError(f"{file}: the bag breaks off or is damaged ({reason}); {advice}") from None


def _records(stream: BinaryIO, size: int, torn_ok: bool) -> Iterator[McapRecord]:
    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
    for record in reader.records:
        if isinstance(record, Chunk):
            size = max(record.uncompressed_size, _unpacked(record))
            if size > _LARGEST_CHUNK:
                raise ValueError(f"a chunk of {size} bytes; at most {_LARGEST_CHUNK}")
            yield from breakup_chunk(record, validate_crc=True)
            continue
        if isinstance(record, Attachment) and not _attachment_whole(stream, record):
            if torn_ok:
                continue
            raise ValueError(f"the attachment {record.name} is damaged")
        if isinstance(record, Footer) and not torn_ok:
            _check_summary(stream, record)
        yield record


def _unpacked(chunk: Chunk) -> int:
    """Return the size a chunk's own compression states, for which its library takes memory, whatever the record says.

    Of LZ4, which may not state one, the most it can be.
    """
    if chunk.compression == "zstd":
        return int(zstandard.frame_content_size(chunk.data))
    return _LZ4 * len(chunk.data) if chunk.compression == "lz4" else len(chunk.data)


def _attachment_whole(stream: BinaryIO, record: Attachment) -> bool:
    """Whether the checksum that ends an attachment, which has just been read, is that of its contents; 0: has none."""
    stream.seek(-_CRC_SIZE, 1)
    stored, written = stream.read(_CRC_SIZE), RecordBuilder()
    record.write(written)
    computed = bytes(written.end())[-_CRC_SIZE:]  # type: ignore[no-untyped-call]
    return stored in (bytes(_CRC_SIZE), computed)


def _check_summary(stream: BinaryIO, footer: Footer) -> None:
    """Raise ValueError where the checksum of index and footer, which has just been read, is not theirs; 0: has none."""
    end = stream.tell()
    begin = footer.summary_start or end - _FOOTER_SIZE
    if footer.summary_crc and begin < end:
        stream.seek(begin)
        if zlib.crc32(stream.read(end - begin)[:-_CRC_SIZE]) != footer.summary_crc:
            raise ValueError("its index is damaged")


def verify(path: Path) -> Verified:
    """Read and decode every message of the bag, in order and by its index, and compare with metadata.yaml.

    Raises BagError where it is not whole.
    """
    file = find_file(path)
    channels: dict[int, Channel] = {}
    decoder, counts = Decoder(), Counter[str]()
    start, end = sys.maxsize, 0  # no list: a day of the bench has 9 million messages
    for record in records(file):
        if isinstance(record, Schema):
            decoder.add(record)
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channel_of(record, channels)
            decoder.decode(channel.schema_id, record.data)
            counts[channel.topic] += 1
            start, end = min(start, record.log_time), max(end, record.log_time)
    _read_by_index(file, counts.total())
    _compare(file, counts)
    return Verified(file.parent, counts.total(), dict(counts), file.stat().st_size, min(start, end), end)


def channel_of(message: Message, channels: Mapping[int, Channel]) -> Channel:
    """Return the channel of a message; raise BagError where the bag does not have it."""
    if message.channel_id not in channels:
        raise BagError(f"a message is of channel {message.channel_id}, which the bag does not have: it is damaged")
    return channels[message.channel_id]


def _read_by_index(file: Path, messages: int) -> None:
    """Read the bag as other programs do; raise BagError where they do not find all its messages."""
    with file.open("rb") as stream:
        try:
            reader = make_reader(stream, validate_crcs=True)
            found = sum(1 for _ in reader.iter_messages(log_time_order=False))
        except Exception as error:  # as above
            raise BagError(f"{file}: its index cannot be used ({error}); `repair` writes it anew") from None
    if found != messages:
        raise BagError(f"{file}: its index leads to {found} of {messages} messages; `repair` writes it anew")


def _compare(file: Path, counts: Counter[str]) -> None:
    path = file.parent / metadata.FILE_NAME
    repair = f"`python -m atpid_control.recording repair {file.parent}` writes it anew"
    if not path.is_file():
        raise BagError(f"{file.parent}: {metadata.FILE_NAME} is missing, so the recording was not closed; {repair}")
    try:
        document = parse_yaml(read_text(path, _MOST_METADATA))
        listed = document["rosbag2_bagfile_information"]["topics_with_message_count"]
        counted = {str(entry["topic_metadata"]["name"]): int(entry["message_count"]) for entry in listed}
    except (FileError, LookupError, TypeError, ValueError, OverflowError):
        raise BagError(f"{path}: not what rosbag2 writes; {repair}") from None
    wrong = sorted(topic for topic in counted.keys() | counts.keys() if counted.get(topic, 0) != counts[topic])
    if wrong:
        raise BagError(
            f"{path}: lists {counted.get(wrong[0], 0)} messages on {wrong[0]}, the file holds {counts[wrong[0]]}; "
            f"{repair}"
        )


def repair(path: Path) -> Verified:
    """Make a bag whole that was not closed: every complete chunk is kept, index and metadata.yaml are written anew.

    The damaged file stays beside it, renamed to end in .damaged; one that is there from before is kept as well. A whole
    bag is left as it is. Raises BagError.
    """
    file = find_file(path)
    try:
        return verify(path)
    except BagError:
        pass
    partial = _unused(file.with_suffix(".mcap.partial"))
    try:
        summary, run = _copy(file, partial)
        file.rename(_unused(file.with_suffix(".mcap.damaged")))
        partial.rename(file)
        metadata.write(file.parent, summary, {**run, "repaired": "index and metadata.yaml written anew after a crash"})
    except OSError as error:
        raise BagError(f"{file.parent}: cannot repair the bag: {in_words(error)}") from None
    finally:
        partial.unlink(missing_ok=True)
    return verify(path)


def _unused(path: Path) -> Path:
    """Return `path`, or the first of `path.2`, `path.3`, ... that is no file yet."""
    names = (path if number == 1 else path.with_name(f"{path.name}.{number}") for number in count(1))
    return next(name for name in names if not name.exists())


def _copy(file: Path, target: Path) -> tuple[BagSummary, dict[str, str]]:
    """Copy every record that can be read into a finished file; return its summary and the run's description."""
    summary, run = BagSummary(file.name), {"run_id": "unknown"}
    topics: dict[int, str] = {}
    schemas: dict[int, int] = {}
    names: dict[int, str] = {}
    channels: dict[int, int] = {}
    with target.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD, enable_data_crcs=True)
        for record in records(file, torn_ok=True):
            if isinstance(record, Footer):
                break
            if isinstance(record, Header):
                writer.start(profile=record.profile, library=LIBRARY)
            elif isinstance(record, Schema) and record.id not in schemas:
                names[record.id] = record.name
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels and record.schema_id in schemas:
                topics[record.id] = record.topic
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
                qos = _qos(record)
                type_hash = record.metadata.get("topic_type_hash", "")
                summary.topics[record.topic] = TopicSummary(record.topic, names[record.schema_id], type_hash, qos)
            elif isinstance(record, Message) and record.channel_id in channels:
                writer.add_message(
                    channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
                )
                summary.add(topics[record.channel_id], record.log_time)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
                run.update(record.metadata if record.name in (RUN, RESULT) else {})
            elif isinstance(record, Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        writer.finish()  # type: ignore[no-untyped-call]
    return summary, run


def _qos(channel: Channel) -> list[Any]:
    """Return the offered profiles a channel lists; none where they cannot be read: those of rosbag2 then apply."""
    text = channel.metadata.get("offered_qos_profiles", "")
    try:
        found = parse_yaml(text) if len(text) < _MOST_METADATA else None
    except FileError:
        return []
    return found if isinstance(found, list) else []
