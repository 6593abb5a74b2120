# SPDX-License-Identifier: Apache-2.0
"""Verifies a bag by reading every message, and repairs one that a crash left incomplete.

`mcap recover` may succeed on a file that cannot be read; here success means that every message was decoded.
"""

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import CompressionType, Writer
from zstandard import ZstdError

from atpid_control.bags import metadata
from atpid_control.bags.decode import Decoder
from atpid_control.bags.errors import BagError, in_words
from atpid_control.bags.metadata import RESULT, RUN, BagSummary, TopicSummary
from atpid_control.bags.writer import CHUNK, LIBRARY

_MAGIC = b"\x89MCAP0\r\n"
_TORN = (McapError, CRCValidationError, ZstdError, struct.error, UnicodeDecodeError, EOFError)


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
    if not path.exists():
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

    A file that breaks off raises BagError, or just ends with `torn_ok`.
    """
    with file.open("rb") as stream:
        try:
            yield from StreamReader(stream, validate_crcs=True).records
        except _TORN as error:
            if torn_ok:
                return
            reason = str(error) or type(error).__name__
            advice = f"`python -m atpid_control.recording repair {file.parent}` saves what is whole"
            raise BagError(f"{file}: the bag breaks off or is damaged ({reason}); {advice}") from None


def verify(path: Path) -> Verified:
    """Read and decode every message of the bag, compare with metadata.yaml; raise BagError where it is not whole."""
    file = find_file(path)
    channels: dict[int, Channel] = {}
    decoder, counts, times = Decoder(), Counter[str](), []
    for record in records(file):
        if isinstance(record, Schema):
            decoder.add(record)
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            decoder.decode(channels[record.channel_id].schema_id, record.data)
            counts[channels[record.channel_id].topic] += 1
            times.append(record.log_time)
    _compare(file, counts)
    return Verified(
        file.parent, len(times), dict(counts), file.stat().st_size, min(times, default=0), max(times, default=0)
    )


def _compare(file: Path, counts: Counter[str]) -> None:
    path = file.parent / metadata.FILE_NAME
    repair = f"`python -m atpid_control.recording repair {file.parent}` writes it anew"
    if not path.is_file():
        raise BagError(f"{file.parent}: {metadata.FILE_NAME} is missing, so the recording was not closed; {repair}")
    try:
        listed = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"][
            "topics_with_message_count"
        ]
        counted = {entry["topic_metadata"]["name"]: int(entry["message_count"]) for entry in listed}
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        raise BagError(f"{path}: not what rosbag2 writes; {repair}") from None
    wrong = sorted(topic for topic in counted.keys() | counts.keys() if counted.get(topic, 0) != counts[topic])
    if wrong:
        raise BagError(
            f"{path}: lists {counted.get(wrong[0], 0)} messages on {wrong[0]}, the file holds {counts[wrong[0]]}; "
            f"{repair}"
        )


def repair(path: Path) -> Verified:
    """Make a bag whole that was not closed: every complete chunk is kept, index and metadata.yaml are written anew.

    The damaged file stays beside it, renamed to end in .damaged. A whole bag is left as it is. Raises BagError.
    """
    file = find_file(path)
    try:
        return verify(path)
    except BagError:
        pass
    partial = file.with_suffix(".mcap.partial")
    try:
        summary, run = _copy(file, partial)
        file.rename(file.with_suffix(".mcap.damaged"))
        partial.rename(file)
        metadata.write(file.parent, summary, {**run, "repaired": "index and metadata.yaml written anew after a crash"})
    except OSError as error:
        raise BagError(f"{file.parent}: cannot repair the bag: {in_words(error)}") from None
    return verify(path)


def _copy(file: Path, target: Path) -> tuple[BagSummary, dict[str, str]]:
    """Copy every record that can be read into a finished file; return its summary and the run's description."""
    summary, run = BagSummary(file.name), {"run_id": "unknown"}
    topics: dict[int, str] = {}
    schemas: dict[int, int] = {}
    names: dict[int, str] = {}
    channels: dict[int, int] = {}
    with target.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD, enable_crcs=True)
        for record in records(file, torn_ok=True):
            if isinstance(record, Footer):
                break
            if isinstance(record, Header):
                writer.start(profile=record.profile, library=LIBRARY)
            elif isinstance(record, Schema) and record.id not in schemas:
                names[record.id] = record.name
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels:
                topics[record.id] = record.topic
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
                qos = yaml.safe_load(record.metadata.get("offered_qos_profiles", "")) or []
                type_hash = record.metadata.get("topic_type_hash", "")
                summary.topics[record.topic] = TopicSummary(record.topic, names[record.schema_id], type_hash, qos)
            elif isinstance(record, Message):
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
