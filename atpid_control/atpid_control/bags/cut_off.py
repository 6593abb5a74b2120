# SPDX-License-Identifier: Apache-2.0
"""Bags that are cut off, damaged or without index, for commands that read what is there: a line for what is not."""

from collections import Counter
from collections.abc import Iterator, Mapping
from copy import copy
from pathlib import Path
from typing import Any

from mcap.records import Channel, DataEnd, Footer, McapRecord, Message, Metadata, Schema

from atpid_control.bags.decode import Decoder
from atpid_control.bags.errors import BagError
from atpid_control.bags.losses import scans_of, stamp_of
from atpid_control.bags.metadata import FILE_NAME, RESULT, RUN
from atpid_control.bags.parts import check_listed, counts_in, find_parts, read_metadata
from atpid_control.bags.records import records

_ADVICE = "`python -m atpid_control.recording recover {}` writes a whole bag"
_BLOCK = "atpid_interfaces/msg/SampleBlock"


class _Seen:
    """The first and last blocks of samples of one file, as they are in it: decoded only where it breaks off."""

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.counts: Counter[int] = Counter()
        self._schemas: dict[int, Schema] = {}
        self._first: tuple[int, bytes] | None = None
        self._last: dict[int, bytes] = {}

    def take(self, record: McapRecord) -> None:
        """Keep what is needed; a copy, since readers of several files renumber the records."""
        if isinstance(record, Schema):
            self._schemas[record.id] = copy(record)
        elif isinstance(record, Channel):
            self.channels[record.id] = copy(record)
        elif isinstance(record, Message):
            self.counts[record.channel_id] += 1
            channel = self.channels.get(record.channel_id)
            schema = self._schemas.get(channel.schema_id) if channel else None
            if schema is not None and schema.name == _BLOCK:
                self._last[record.channel_id] = record.data
                self._first = self._first or (record.channel_id, record.data)

    def start_ns(self) -> int | None:
        """Return the stamp of the first sample [ns]; None where there is none."""
        found = self._block(*self._first) if self._first else None
        return None if found is None else stamp_of(found)

    def last(self) -> dict[str, tuple[int, int]]:
        """Return the end of the last sample [ns] and its index by topic."""
        found = {}
        for channel, data in self._last.items():
            block = self._block(channel, data)
            if block is not None and block.rate > 0.0:
                scans = scans_of(block)
                end = stamp_of(block) + round(scans / block.rate * 1e9)
                found[self.channels[channel].topic] = end, int(block.first_index) + scans - 1
        return found

    def _block(self, channel: int, data: bytes) -> Any:
        """Return a block; None where it cannot be used."""
        decoder, schema = Decoder(), self._schemas[self.channels[channel].schema_id]
        try:
            decoder.add(schema)
            block = decoder.decode(schema.id, data)
            return block if len(block.channels) else None
        except BagError:
            return None


class Parts:
    """The files of a bag, each read as far as it goes."""

    def __init__(self, path: Path) -> None:
        """Find them. Raises BagError: no bag, or not the files that metadata.yaml lists."""
        self.path, self.files = path, find_parts(path)
        self.messages: Counter[str] = Counter()
        self._about: Mapping[str, Any] = {}
        self._kept: set[str] = set()  # names of the metadata records
        self._start_ns: int | None = None  # stamp of the first sample
        self._lines: list[str] = []
        self._cut = False
        if path.is_dir() and (path / FILE_NAME).is_file():
            try:
                self._about = read_metadata(path)
            except BagError as error:
                self._lines.append(str(error))
            else:
                check_listed(path, self.files, self._about)

    def records(self, file: Path) -> Iterator[McapRecord]:
        """Yield the records of one of the files, all checksums checked, as far as it goes."""
        whole = complete = False
        seen = _Seen()
        for record in records(file, torn_ok=True):
            complete = complete or isinstance(record, DataEnd)
            whole = whole or isinstance(record, Footer)
            if isinstance(record, Metadata):
                self._kept.add(record.name)
            elif isinstance(record, Message) and record.channel_id in seen.channels:
                self.messages[seen.channels[record.channel_id].topic] += 1
            seen.take(record)
            yield record
        if self._start_ns is None:
            self._start_ns = seen.start_ns()
        if not whole:
            self._cut = True
            self._lines.append(f"{file}: {self._ending(seen, complete)}; {_ADVICE.format(self.path)}")

    def _ending(self, seen: _Seen, complete: bool) -> str:
        if complete:
            return "its index is cut off, every message is there"
        last = seen.last()
        if not last or self._start_ns is None:
            return f"cut off or damaged before its first sample: {sum(seen.counts.values())} messages read"
        after = max(end_ns for end_ns, _ in last.values()) - self._start_ns
        samples = ", ".join(f"{index} of {topic}" for topic, (_, index) in sorted(last.items()))
        return f"cut off or damaged after {after * 1e-9:.6g} s: read until sample {samples}"

    @property
    def missing(self) -> list[str]:
        """What is not in the bag and should be, a line each; known when all files have been read."""
        lines = list(self._lines)
        kept = self._about.get("custom_data")
        lost = kept.get("lost", "nothing") if isinstance(kept, dict) else "nothing"
        if lost != "nothing":
            lines.append(f"{self.path}: recovered from a damaged bag, of which is lost: {lost}")
        elif not self._cut and RUN in self._kept and RESULT not in self._kept:
            lines.append(f"{self.path}: the recording was not closed: what was not written yet is not there")
        try:
            listed = counts_in(self._about)
        except BagError:
            listed = {}
        for name, count in listed.items():
            if short := max(0, count - self.messages[name]):
                lines.append(f"{self.path}: {name}: {short} of {count} messages that metadata.yaml lists are missing")
        return lines
