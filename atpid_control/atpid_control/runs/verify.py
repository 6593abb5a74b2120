# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verifies a bag by reading every message, and names by sample index what is missing in it.

`mcap recover` may succeed on a file that cannot be read; here success means that every message was decoded.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Header, McapRecord, Message, Schema, Statistics

from atpid_control.runs.decode import Decoded, Decoder, scans_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import SQLITE_ENDING, check_listed, find_parts, read_metadata
from atpid_control.runs.records import IDS, NO_RECOVERY, BoundedFile, channel_of, plain, records, renumbered
from atpid_control.runs.salvage import Damage, salvage
from atpid_control.runs.writer import LIBRARY

#: Losses of one topic, and damaged parts of a file, that are listed; the others are counted.
_LISTED = 20


@dataclass
class _Stream:
    """What came of one topic."""

    messages: int = 0
    sequence: int | None = None  # that has to come next
    index: int | None = None  # of the scan that has to come next; None: no blocks
    lines: list[str] = field(default_factory=list)
    gaps: int = 0
    scans: int = 0  # missing
    missing: int = 0  # messages missing

    def add_gap(self, line: str) -> None:
        self.gaps += 1
        if len(self.lines) < _LISTED:
            self.lines.append(line)


class Losses:
    """Takes the messages of a bag in the order of the file and finds what is missing between and after them.

    Blocks have the index of their first scan; any message has its number in its topic, where `recorder_node` wrote the
    file. A gap in the scans without one in the messages was lost before the recorder.
    """

    def __init__(self) -> None:
        self._streams: dict[str, _Stream] = {}
        self.numbered = True  # whether the messages of the present file are, from 0 on in each topic

    def add(self, topic: str, sequence: int, message: Decoded) -> None:
        """Take a decoded message."""
        stream = self._streams.setdefault(topic, _Stream())
        skipped = 0
        if self.numbered:
            expected = 0 if stream.sequence is None else stream.sequence
            skipped = max(0, sequence - expected)
            stream.sequence = sequence + 1
        stream.missing += skipped
        stream.messages += 1
        first, before = _first_of(message), stream.index
        if first is not None:
            stream.index = first + scans_of(message)
            if before is not None and first > before:
                where = " before the recorder" if self.numbered and not skipped else ""
                stream.scans += first - before
                stream.add_gap(f"{topic}: scans {before} to {first - 1} lost{where} ({first - before})")
                return
            if before is None and skipped:
                stream.scans += first
                stream.add_gap(f"{topic}: {_span(0, skipped)}, before scan {first}")
                return
        if skipped:
            stream.add_gap(f"{topic}: {_span(sequence - skipped, skipped)}")

    def lines(self, counts: Mapping[str, int] | None = None) -> list[str]:
        """Return a line for each loss; `counts`: the messages written of each topic, where the bag states them."""
        lines: list[str] = []
        for topic in sorted(self._streams.keys() | (counts or {}).keys()):
            stream = self._streams.get(topic, _Stream())
            lines += stream.lines
            if stream.gaps > len(stream.lines):
                lines.append(f"{topic}: and {stream.gaps - len(stream.lines)} more losses, {stream.scans} scans in all")
            tail = (counts or {}).get(topic, 0) - stream.messages - stream.missing
            if tail > 0:
                begin = stream.messages + stream.missing
                scans = "" if stream.index is None else f": every scan from {stream.index} on"
                lines.append(f"{topic}: {_span(begin, tail)}, the last{scans}")
        return lines

    def ends(self) -> list[str]:
        """Return a line for each stream of blocks: the index of its last scan."""
        streams = sorted(self._streams.items())
        return [f"{topic}: ends with scan {one.index - 1}" for topic, one in streams if one.index]


def _first_of(message: Decoded) -> int | None:
    """Return the index of the first scan of a block; None: a message of another kind, or an invalid one."""
    try:
        scans_of(message)
        return int(message.first_index)
    except (AttributeError, TypeError, ValueError, ZeroDivisionError):
        return None


def _span(first: int, count: int) -> str:
    return f"message {first} lost" if count == 1 else f"messages {first} to {first + count - 1} lost ({count})"


@dataclass(frozen=True)
class Verified:
    """What reading every message of a bag showed."""

    folder: Path
    messages: int
    by_topic: dict[str, int]
    size: int  # [bytes]
    start_ns: int
    end_ns: int
    lost: tuple[str, ...] = ()  # what is missing, by sample index, a line each
    unread: tuple[str, ...] = ()  # topics that were counted and not decoded, a line each
    problem: str = ""  # why index or metadata.yaml do not fit the messages; empty: the bag is whole


class Pass:
    """One pass over the messages of a bag: each is decoded and counted, and what is missing between them found."""

    def __init__(self, strict: bool) -> None:
        """Raise BagError for a message that cannot be decoded, where `strict`; else count it as lost."""
        self._strict = strict
        self.decoder, self.channels = Decoder(), dict[int, Channel]()
        self._unknown: dict[int, str] = {}  # definitions of another program that cannot be read: why
        self.unread: dict[str, str] = {}  # topics with messages of them
        self.losses, self.counts = Losses(), Counter[str]()
        self.written = Counter[str]()  # messages of each topic by the files' own statistics
        self.start, self.end = sys.maxsize, 0  # no list: a day of the bench has 9 million messages

    def take(self, record: McapRecord, place: int) -> bool:
        """Take a record of the file at `place`; return whether it can be used. Raises BagError."""
        try:
            self._take(record, place)
        except BagError:
            if self._strict:
                raise
            return False
        return True

    def decoded(self, channel: Channel, message: Decoded) -> None:
        """Take each message that can be decoded; here it is of no use."""

    def _take(self, record: McapRecord, place: int) -> None:
        if isinstance(record, Header):
            self.losses.numbered = record.library == LIBRARY
        elif isinstance(record, Schema):
            try:
                self.decoder.add(record)
            except BagError as error:
                if self.losses.numbered:  # of our own recorder: damaged
                    raise
                self._unknown[record.id] = str(error)
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Statistics):
            for number, count in record.channel_message_counts.items():
                known = self.channels.get(number + place * IDS)
                self.written[known.topic if known else f"channel {number}"] += count
        elif isinstance(record, Message):
            channel = channel_of(record, self.channels)
            self.counts[channel.topic] += 1
            if channel.schema_id in self._unknown:
                self.unread[channel.topic], message = self._unknown[channel.schema_id], None
            else:
                message = self.decoder.decode(channel.schema_id, record.data)
                self.decoded(channel, message)
            self.start, self.end = min(self.start, record.log_time), max(self.end, record.log_time)
            self.losses.add(channel.topic, record.sequence, message)


def verify(path: Path) -> Verified:
    """Read and decode every message of the bag; raise BagError where it is not whole."""
    found = read_through(path, Pass(strict=True))
    if found.problem:
        raise BagError(found.problem)
    return found


def read_through(path: Path, seen: Pass) -> Verified:
    """Give every record of the bag to `seen`, then read it by its index, and compare with metadata.yaml.

    Raises BagError where it cannot be read to its end.
    """
    files, totals, problem = find_parts(path), [0], ""
    for place, file in enumerate(files):
        for record in records(file):
            seen.take(renumbered(record, place), place)
        totals.append(seen.counts.total())
    try:
        for file, before, after in zip(files, totals, totals[1:], strict=False):
            if file.suffix != SQLITE_ENDING:
                _read_by_index(file, after - before)
        _compare(path, files, seen.counts)
    except BagError as error:
        problem = str(error)
    size = sum(file.stat().st_size for file in files)
    times, lost = (min(seen.start, seen.end), seen.end), tuple(seen.losses.lines())
    unread = tuple(f"{topic}: {why}" for topic, why in seen.unread.items())
    return Verified(files[0].parent, totals[-1], dict(seen.counts), size, *times, lost, unread, problem)


def survey(path: Path) -> list[str]:
    """Return what is lost in a damaged bag, by sample index, a line each; memory does not grow. Raises BagError."""
    files = find_parts(path, damaged=True)
    seen, lines = Pass(strict=False), list[str]()
    for place, file in enumerate(files):
        for record in salvaged(file, lines):
            seen.take(renumbered(record, place), place)
    return [*lines, *seen.losses.lines(written(files, seen)), *seen.losses.ends()]


def salvaged(file: Path, lines: list[str]) -> Iterator[McapRecord]:
    """Yield the records of a file that are whole; a line for each part that is not goes to `lines`. Raises BagError."""
    left_out = 0
    if file.suffix == SQLITE_ENDING:
        raise BagError(f"{file}: a bag in sqlite3 is not recovered here; {NO_RECOVERY}")
    try:
        for record in plain(salvage(file)):
            if not isinstance(record, Damage):
                yield record
                continue
            left_out += 1
            if left_out <= _LISTED:
                size = f", bytes {record.begin} to {record.end - 1}" if record.end > record.begin else ""
                lines.append(f"{file.name}{size}: {record.why}")
    except OSError as error:
        raise BagError(f"{file}: cannot be read ({error.strerror}); give a bag that can") from None
    if left_out > _LISTED:
        lines.append(f"{file.name}: and {left_out - _LISTED} more damaged parts")


def written(files: Sequence[Path], seen: Pass) -> Mapping[str, int]:
    """Return how many messages of each topic were written, by metadata.yaml or the files' own statistics."""
    counts = Counter(seen.written)
    if len(files) > 1 or _alone(files[0]):
        with suppress(BagError):  # of a recording that was not closed
            counts |= Counter(read_metadata(files[0].parent).counts)
    return {topic: count for topic, count in counts.items() if 0 < count < _MOST_COUNTED}


#: A stated number of messages above it is none.
_MOST_COUNTED = 10**12


def _alone(file: Path) -> bool:
    return len(list(file.parent.glob("*.mcap"))) == 1


def _read_by_index(file: Path, messages: int) -> None:
    """Read the bag as other programs do; raise BagError where they do not find all its messages."""
    with file.open("rb") as stream:
        try:
            reader = make_reader(BoundedFile(stream), validate_crcs=True)  # type: ignore[arg-type]
            found = sum(1 for _ in reader.iter_messages(log_time_order=False))
        except Exception as error:  # the library raises many types of errors for an index that leads astray
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            raise BagError(f"{file}: its index cannot be used ({reason}); `atpid bag recover` writes it anew") from None
    if found != messages:
        raise BagError(f"{file}: its index leads to {found} of {messages} messages; `atpid bag recover` writes it anew")


def _compare(path: Path, files: Sequence[Path], counts: Mapping[str, int]) -> None:
    """Raise BagError where metadata.yaml lists other files, or other numbers of messages, than there are."""
    folder = files[0].parent
    listed = read_metadata(folder)
    if path.is_dir():
        check_listed(folder, files, listed)
    elif not _alone(files[0]):
        return
    counted = listed.counts
    wrong = sorted(topic for topic in counted.keys() | counts.keys() if counted.get(topic, 0) != counts.get(topic, 0))
    if wrong:
        raise BagError(
            f"{folder / 'metadata.yaml'}: lists {counted.get(wrong[0], 0)} messages on {wrong[0]}, the files hold "
            f"{counts.get(wrong[0], 0)}; `atpid bag recover {folder}` writes it anew"
        )
