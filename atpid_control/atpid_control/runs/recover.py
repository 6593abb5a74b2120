# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Makes a bag whole that was cut off or damaged: what can be read is kept, index and metadata.yaml are written anew.

`recover` writes another bag and leaves the damaged one as it is; `repair` puts the new files in the place of the old,
which are kept beside them. Either states by sample index what is lost.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from itertools import count
from pathlib import Path
from tempfile import mkdtemp

from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from atpid_common.files import Document, FileError, parse_yaml
from atpid_control.runs import metadata
from atpid_control.runs.errors import BagError, in_words
from atpid_control.runs.metadata import RESULT, RUN, BagSummary, TopicSummary
from atpid_control.runs.parts import find_parts
from atpid_control.runs.records import renumbered
from atpid_control.runs.salvage import NOT_CLOSED
from atpid_control.runs.verify import Pass, Verified, salvaged, verify, written
from atpid_control.runs.writer import CHUNK, LIBRARY, SpooledIndex, check_new

#: Name of the metadata record that states what was lost.
_RECOVERED = "atpid_recovered"
#: Characters of the losses that are kept in the bag itself.
_MOST_STATED = 10_000
_MOST_QOS = 200_000


@dataclass(frozen=True)
class Recovered:
    """A bag that was made whole."""

    verified: Verified
    lost: list[str]  # what is not in it, by sample index, a line each
    made: bool  # False: it was whole, nothing was written


def recover(path: Path, out: Path | None = None) -> Recovered:
    """Write what can be read of the bag `path` to the new folder `out`; `path` stays as it is.

    `out` is `path` with -recovered at its end unless given. Nothing is written where the bag is whole. Raises BagError.
    """
    files = find_parts(path, damaged=True)
    try:
        return Recovered(verify(path), [], made=False)
    except BagError as error:
        reason = str(error)
    target = out if out is not None else path.absolute().with_name(f"{path.absolute().stem}-recovered")
    check_new(target)
    with building(target.absolute().parent, target.name) as folder:
        names = [f"{target.name}_{place}.mcap" for place in range(len(files))]
        lost = _Copy(folder, reason).all(files, names)
        folder.rename(target)
    return Recovered(verify(target), lost, made=True)


def repair(path: Path) -> Recovered:
    """Put whole files in the place of those of the bag `path`; the damaged ones stay beside them, as .damaged.

    One that is there from before is kept as well. A whole bag is left as it is. Raises BagError.
    """
    files = find_parts(path, damaged=True)
    try:
        return Recovered(verify(path), [], made=False)
    except BagError as error:
        reason = str(error)
    with building(files[0].parent, files[0].stem) as folder:
        lost = _Copy(folder, reason).all(files, [file.name for file in files])
        for file in files:
            file.rename(_unused(file.with_suffix(".mcap.damaged")))
            (folder / file.name).rename(file)
        (folder / metadata.FILE_NAME).replace(files[0].parent / metadata.FILE_NAME)
    return Recovered(verify(path), lost, made=True)


@contextmanager
def building(parent: Path, name: str, what: str = "the recovered bag") -> Iterator[Path]:
    """Make a folder to build a bag in; what is left of it after an error, such as a full disk, is removed."""
    folder: Path | None = None
    try:
        parent.mkdir(parents=True, exist_ok=True)
        folder = Path(mkdtemp(dir=parent, prefix=f".{name[:100]}-", suffix=".partial"))
        mask = os.umask(0o022)
        os.umask(mask)
        folder.chmod(0o777 & ~mask)
        yield folder
    except OSError as error:
        raise BagError(f"{parent}: cannot write {what}: {in_words(error)}") from None
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def _unused(path: Path) -> Path:
    """Return `path`, or the first of `path.2`, `path.3`, ... that is no file yet."""
    names = (path if number == 1 else path.with_name(f"{path.name}.{number}") for number in count(1))
    return next(name for name in names if not name.exists())


class _Copy:
    """Copies what can be read of each file, and finds what is lost."""

    def __init__(self, folder: Path, reason: str) -> None:
        self._folder, self._reason = folder, reason
        self._seen = Pass(strict=False)
        self._run = {"run_id": "unknown"}
        self._lines: list[str] = []
        self._unusable = 0

    def all(self, files: list[Path], names: list[str]) -> list[str]:
        """Write each file anew under its name, then metadata.yaml; return what is lost. Raises OSError, BagError."""
        summary = BagSummary(names[0])
        for place, (file, name) in enumerate(zip(files, names, strict=True)):
            if place:
                summary.begin_file(name)
            self._file(file, place, self._folder / name, summary, last=files[-1] == file)
        lost = self._lost(files)
        stated = "; ".join(lost)[:_MOST_STATED] or "nothing"
        own = {"repaired": "index and metadata.yaml written anew", "lost": stated}
        metadata.write(self._folder, summary, self._run | own)
        return lost

    def _lost(self, files: list[Path]) -> list[str]:
        lines = [*self._lines, *self._seen.losses.lines(written(files, self._seen))]
        if self._unusable:
            lines.append(f"{self._unusable} messages that cannot be decoded")
        if any(line.endswith(NOT_CLOSED) for line in self._lines):
            period = self._run.get("chunk_period", "")
            most = f", as a rule {period} s at most" if period else ""
            lines += ["what the recorder had received and not yet written" + most, *self._seen.losses.ends()]
        return lines

    def _file(self, file: Path, place: int, target: Path, summary: BagSummary, *, last: bool) -> None:
        """Copy every record of `file` that can be used into a finished file."""
        with target.open("xb") as stream:
            writer = Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD, enable_data_crcs=True)
            writer._Writer__chunk_indices = SpooledIndex(self._folder)  # type: ignore[attr-defined]
            ids = _Ids(writer, summary)
            started = False
            for record in salvaged(file, self._lines):
                if not started:  # the header of a damaged file may be missing
                    writer.start(profile="ros2", library=record.library if isinstance(record, Header) else LIBRARY)
                    started = True
                record = renumbered(record, place)
                usable = self._seen.take(record, place)
                if isinstance(record, Message) and not usable:
                    self._unusable += 1
                elif isinstance(record, Metadata):
                    writer.add_metadata(record.name, record.metadata)
                    self._run.update(record.metadata if record.name in (RUN, RESULT) else {})
                elif usable:
                    ids.add(record)
            if not started:
                writer.start(profile="ros2", library=LIBRARY)
            if last:
                stated = {"reason": self._reason[:_MOST_STATED], "damaged": "; ".join(self._lines)[:_MOST_STATED]}
                writer.add_metadata(_RECOVERED, stated)
            writer.finish()  # type: ignore[no-untyped-call]
            stream.flush()
            os.fsync(stream.fileno())


class _Ids:
    """Schemas and channels of the file that is written, by the ids in the one that is read."""

    def __init__(self, writer: Writer, summary: BagSummary) -> None:
        self._writer, self._summary = writer, summary
        self._schemas: dict[int, int] = {}
        self._names: dict[int, str] = {}
        self._channels: dict[int, tuple[int, str]] = {}

    def add(self, record: McapRecord) -> None:
        """Write a record."""
        if isinstance(record, Schema) and record.id not in self._schemas:
            self._names[record.id] = record.name
            self._schemas[record.id] = self._writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in self._channels and record.schema_id in self._schemas:
            self._add_channel(record)
        elif isinstance(record, Message) and record.channel_id in self._channels:
            channel, topic = self._channels[record.channel_id]
            self._writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            self._summary.add(topic, record.log_time)
        elif isinstance(record, Attachment):
            times = record.create_time, record.log_time
            self._writer.add_attachment(*times, record.name, record.media_type, record.data)

    def _add_channel(self, record: Channel) -> None:
        schema = self._schemas[record.schema_id]
        made = self._writer.register_channel(record.topic, record.message_encoding, schema, record.metadata)
        self._channels[record.id] = made, record.topic
        type_hash = record.metadata.get("topic_type_hash", "")
        qos = deepcopy(_profiles(record.metadata.get("offered_qos_profiles", "")))
        name = self._names[record.schema_id]
        self._summary.topics.setdefault(record.topic, TopicSummary(record.topic, name, type_hash, qos))


@lru_cache(maxsize=64)
def _profiles(text: str) -> list[Document]:
    """Return the profiles in a text, which most channels of a bag share and which takes milliseconds to read.

    None where they cannot be read: those of rosbag2 then apply.
    """
    try:
        found = parse_yaml(text) if len(text) < _MOST_QOS else None
    except FileError:
        return []
    return found if isinstance(found, list) else []
