# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is missing in a bag, by sample index: which topic, from which scan or message to which, how many."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: Losses of one topic that are listed; the others are counted.
LISTED = 20


def scans_of(block: Any) -> int:
    """Return how many scans a SampleBlock or PlantTruth has."""
    return len(block.support) if hasattr(block, "support") else len(block.data) // len(block.channels)


def stamp_of(message: Any) -> int:
    """Return the stamp in the header of a decoded message [ns]."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


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
        if len(self.lines) < LISTED:
            self.lines.append(line)


class Losses:
    """Takes the messages of a bag in the order of the file and finds what is missing between and after them.

    Blocks have the index of their first scan; any message has its number in its topic, where `recorder_node` wrote the
    file. A gap in the scans without one in the messages was lost before the recorder.
    """

    def __init__(self) -> None:
        self._streams: dict[str, _Stream] = {}
        self.numbered = True  # whether the messages of the present file are, from 0 on in each topic

    def add(self, topic: str, sequence: int, message: Any) -> None:
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


def _first_of(message: Any) -> int | None:
    """Return the index of the first scan of a block; None: a message of another kind, or an invalid one."""
    try:
        scans_of(message)
        return int(message.first_index)
    except (AttributeError, TypeError, ValueError, ZeroDivisionError):
        return None


def _span(first: int, count: int) -> str:
    return f"message {first} lost" if count == 1 else f"messages {first} to {first + count - 1} lost ({count})"
