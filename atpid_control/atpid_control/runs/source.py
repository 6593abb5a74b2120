# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag as tables, in one pass and piece by piece: memory does not grow with its length.

Of samples every index has its row, a lost one with NaN, so that nothing is joined over a gap.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.records import Channel
from numpy.typing import NDArray

from atpid_common.vocabulary import DRIVES, Drive
from atpid_control.runs import tables as of_tables
from atpid_control.runs.decode import Decoded, scans_of, stamp_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import Contents, kind_of, reason_to_leave_out
from atpid_control.runs.tables import INDEX, RECEIVED, STAMP, TEXT, TIME, Column, Leaf, Piece, Table, Values
from atpid_sim.system import Array

#: Longest gap inside a segment [s]; all of its gaps together may be as long, and this many times its samples besides.
LONGEST_GAP, _SHARE = 60.0, 10
#: Segments of one topic that are told apart.
_MOST = 20
#: By how much the stamp of a block that continues an earlier segment may differ from its place there [ns].
_TOLERANCE = 1_000_000_000


@dataclass
class _Segment:
    """Blocks whose indices go on."""

    number: int  # from 0 on, in its topic
    layout: tuple[float, tuple[object, ...]]  # rate [Hz], device, channels, units, delays
    first: int  # index of its first scan
    start_ns: int  # and its stamp
    offset: float  # of that scan after the begin of the bag, by stamp as far as that can be [s]
    following: int  # index of the scan after its last
    end_ns: int  # and its stamp, by the last block
    due: tuple[int, int] = (0, 0)  # what these two were before the last block
    jump: str = ""  # why it is another than that of the block before; empty: the first
    scans: int = 0
    lost: int = 0

    @property
    def rate(self) -> float:
        """Rate of its samples [Hz]."""
        return self.layout[0]

    def goes_on(self, layout: tuple[float, tuple[object, ...]], first: int, stamp_ns: int, last: bool) -> bool:
        """Whether a block that begins at index `first` continues it; `last`: it has the block before."""
        ahead = first - self.following
        if layout != self.layout or not 0 <= ahead <= LONGEST_GAP * self.rate:
            return False
        if ahead and self.lost + ahead > LONGEST_GAP * self.rate + _SHARE * self.scans:
            return False
        return last or abs(stamp_ns - self.end_ns - ahead / self.rate * 1e9) < _TOLERANCE


class Segments:
    """The segments of one topic, as its blocks come: the one rule of all readers for gaps and jumps.

    A gap of at most a minute belongs to its segment, and readers fill it with NaN, as long as the gaps of a segment are
    not many times what is there. A step of the index beyond that, ahead or back, begins another one, as do another rate
    and other channels: the work a bag takes grows with the samples in it, whatever their indices are.
    """

    def __init__(self, start_ns: int = 0) -> None:
        """Begin; `start_ns` is the stamp of the bag's first sample."""
        self.all: list[_Segment] = []
        self._start_ns = start_ns
        self._last: _Segment | None = None  # that has the block before

    def place(self, block: Decoded) -> _Segment | str:
        """Return the segment of a block that `message_checks` lets pass, or why it has none."""
        first, scans, stamp = int(block.first_index), scans_of(block), stamp_of(block)
        named = (tuple(getattr(block, name, ())) for name in ("channels", "units", "skew"))
        layout = float(block.rate), (getattr(block, "device", ""), *named)
        before = self._last
        known = [*([before] if before else []), *reversed(self.all)]
        segment = next((one for one in known if one.goes_on(layout, first, stamp, one is before)), None)
        if segment is None:
            # a counter that goes back while time goes on was started anew; the first blocks of it may be lost
            late = before is not None and stamp <= before.end_ns - 0.5e9 / before.rate
            if before is not None and late and layout == before.layout and 0 < first < before.following:
                return f"a block goes back to index {first} after {before.following - 1}"
            if len(self.all) == _MOST:
                return f"its index jumps for the {_MOST}th time"
            segment = _Segment(len(self.all), layout, first, stamp, self._offset(stamp), first, stamp)
            if before is not None:
                segment.jump = f"its index goes from {before.following - 1} to {first}, at {segment.rate:g} Hz"
            self.all.append(segment)
        segment.due = segment.following, segment.end_ns
        segment.lost += first - segment.following
        segment.scans += scans
        segment.following = first + scans
        segment.end_ns = stamp + round(scans / segment.rate * 1e9)
        self._last = segment
        return segment

    def _offset(self, stamp_ns: int) -> float:
        """Return how long after the bag's first sample [s] a segment begins; a stamp far off counts as a limit."""
        if not self.all:
            return (stamp_ns - self._start_ns) * 1e-9
        first, longest = self.all[0], LONGEST_GAP + sum(one.scans / one.rate for one in self.all)
        return first.offset + min(max(0.0, (stamp_ns - first.start_ns) * 1e-9), longest)


#: Series of the simulated plant.
_SERIES = ("support", "beam", "grain", "ceiling")
#: Messages with samples, and their fields that are series.
_SAMPLED = {"SampleBlock": ("channels", "units", "skew", "data"), "PlantTruth": _SERIES}
#: Fields that have the drive's unit, whatever a definition's comment states.
_OF_DRIVE = {
    "PlantTruth": ("support", "excitation_amplitude"),
    "Excitation": ("amplitude", "amplitude_std", "offset", "residual"),
    "CeilingCommand": ("excitation_amplitude",),
}
#: Messages looked through for the channel of what drives the structure: the first block has it.
_LOOKED_THROUGH = 1000
#: Messages of one topic gathered to a piece, and rows of a gap in one.
_MESSAGES, _GAP = 32, 65536


class Source(Contents):
    """A bag to be read once as tables; what it holds besides them is known when `pieces` has ended."""

    def __init__(self, path: Path | str, topics: Sequence[str] = ()) -> None:
        """Open the bag; `topics`: those wanted, all where none is named. Raises BagError."""
        super().__init__(path)
        self._wanted = set(topics)
        self._topics: dict[tuple[str, str, bytes], _Topic] = {}  # by topic, type and definition
        self.start_ns, self._drive = _first_sample(self.path)

    @property
    def tables(self) -> list[Table]:
        """The tables that have been met."""
        tables = []
        for topic in self._topics.values():
            tables += topic.samples.tables if topic.samples else []
            tables += [topic.table] if topic.table.rows or topic.table.left_out else []
        return tables

    def empty(self) -> BagError:
        """Return the error of a bag from which nothing has come, with the reason where there is one."""
        what = f"; {self.missing[0]}" if self.missing else ""
        return BagError(f"{self.path}: no message in this bag can be used{what}; give one with a recording")

    def no_samples(self, form: str) -> BagError:
        """Return the error of a bag, or part of it, whose tables a format for samples cannot hold."""
        what = "there are no samples in this bag, or part of it; give --format csv or mat"
        return BagError(f"{self.path}: --format {form}: {what}")

    @property
    def missing(self) -> list[str]:
        """What the bag does not have and should, a line each; known when `pieces` has ended."""
        lines = self.unread
        for table in self.tables:
            lines += [f"{table.name}: a table of its own: {table.jump}"] if table.jump else []
            if table.lost:
                lines.append(f"{table.name}: {table.lost} samples lost in {len(table.gaps)} gaps; their rows are NaN")
            if reasons := table.left_out:
                first = "" if len(reasons) == 1 else " the first since"
                lines.append(f"{table.name}: {reasons.total()} messages left out:{first} {next(iter(reasons))}")
        return lines

    def pieces(self) -> Iterator[Piece]:
        """Yield the rows of all tables wanted, as they come. Raises BagError: damaged, or without a topic wanted."""
        topics: dict[int, _Topic] = {}  # by channel
        for channel, record in self.records():
            if self._wanted and channel.topic not in self._wanted:
                continue
            if channel.id not in topics:
                topics[channel.id] = self._topic(channel)
            yield from topics[channel.id].rows(self.decoder.decode(channel.schema_id, record.data), record.log_time)
        for topic in self._topics.values():
            yield from topic.flush()
        if unknown := sorted(self._wanted - set(self.types)):
            listed = ", ".join(sorted(self.types)) or "none"
            raise BagError(f"{self.path}: --topic: given {unknown[0]}; in the bag: {listed}")

    def _topic(self, channel: Channel) -> "_Topic":
        """Return the topic of a channel; with another definition it is another one."""
        name, definition = self.decoder.name(channel.schema_id), self.decoder.definition_of(channel.schema_id)
        key = channel.topic, name, definition
        if key not in self._topics:
            same = sum(topic == channel.topic for topic, _, _ in self._topics)
            own = channel.topic.strip("/") + (f"_definition_{same + 1}" if same else "")
            series = _SAMPLED.get(kind_of(name), ())
            known = of_tables.comments(definition.decode(errors="replace"))
            for field in known.keys() & _OF_DRIVE.get(kind_of(name), ()):
                known[field] = self._drive.unit, known[field][1]
            fields = [
                leaf for leaf in of_tables.leaves(self.decoder, channel.schema_id, known) if leaf.path[0] not in series
            ]
            samples = _Samples(own, channel.topic, name, known, self.start_ns) if series else None
            scans = [Column("scans", "", "samples in the block", np.dtype(np.int64))] if series else []
            columns = (*of_tables.common(TIME, STAMP, RECEIVED), *scans, *(leaf.column for leaf in fields))
            table = Table(own + ("_blocks" if series else ""), channel.topic, name, columns)
            stamped = of_tables.has_header(self.decoder, channel.schema_id)
            self._topics[key] = _Topic(kind_of(name), stamped, fields, table, samples, self.start_ns, [])
        return self._topics[key]


def _first_sample(path: Path) -> tuple[int, Drive]:
    """Return the stamp of the bag's first sample, else of its first message [ns], and what drives the structure."""
    bag = Contents(path)
    first = sampled = None
    support, force = DRIVES.values()
    for number, (channel, record) in enumerate(bag.records()):
        kind, message = kind_of(bag.types[channel.topic]), bag.decoder.decode(channel.schema_id, record.data)
        if reason_to_leave_out(kind, message):
            continue
        stamp = stamp_of(message) if of_tables.has_header(bag.decoder, channel.schema_id) else record.log_time
        if kind in _SAMPLED and scans_of(message):
            sampled = stamp if sampled is None else sampled
            channels = getattr(message, "channels", ())
            if support.channel in channels or force.channel in channels:
                return sampled, support if support.channel in channels else force
        if sampled is not None and number > _LOOKED_THROUGH:
            break
        first = stamp if first is None else first
    return sampled or first or 0, support


@dataclass
class _Topic:
    """One topic while it is read: its messages as rows, and its samples where it has some."""

    kind: str  # of atpid_interfaces; empty: of another package
    stamped: bool
    leaves: list[Leaf]
    table: Table
    samples: "_Samples | None"
    start_ns: int
    waiting: list[tuple[object, ...]]

    def rows(self, message: Decoded, log_ns: int) -> Iterator[Piece]:
        """Yield what a message completes."""
        if reason := reason_to_leave_out(self.kind, message):
            self.table.left_out[reason] += 1
            return
        stamp = stamp_of(message) if self.stamped else log_ns
        times = ((stamp - self.start_ns) * 1e-9, stamp, (log_ns - self.start_ns) * 1e-9)
        scans = (scans_of(message),) if self.samples else ()
        self.waiting.append((*times, *scans, *(leaf.value(message) for leaf in self.leaves)))
        self.table.rows += 1
        if self.samples:
            yield from self.samples.rows(message)
        if len(self.waiting) == _MESSAGES:
            yield from self.flush()

    def flush(self) -> Iterator[Piece]:
        """Yield the rows that wait."""
        if self.waiting:
            columns = zip(*self.waiting, strict=True)
            arrays = (_array(values, c.dtype) for values, c in zip(columns, self.table.columns, strict=True))
            yield Piece(self.table, tuple(arrays))
            self.waiting = []


class _Samples:
    """The samples of one topic of SampleBlock or PlantTruth; each of its segments makes a table of its own."""

    def __init__(self, name: str, topic: str, type_name: str, known: dict[str, tuple[str, str]], start_ns: int) -> None:
        self.tables: list[Table] = []
        self._name, self._topic, self._type, self._known, self._start = name, topic, type_name, known, start_ns
        self._segments = Segments(start_ns)

    def rows(self, block: Decoded) -> Iterator[Piece]:
        """Yield the rows of a block, those of the samples lost before it first."""
        segment = self._segments.place(block)
        if isinstance(segment, str):
            self.tables[-1].left_out[segment] += 1
            return
        if segment.number == len(self.tables):
            name = self._name + (f"_{segment.number + 1}" if segment.number else "")
            columns = (*of_tables.common(TIME, STAMP, INDEX), *self._channels(block))
            known = segment.rate, segment.offset, segment.jump, segment.first
            self.tables.append(Table(name, self._topic, self._type, columns, *known))
        table, first, step = self.tables[segment.number], int(block.first_index), 1e9 / segment.rate
        if first > segment.due[0]:
            yield from self._gap(table, *segment.due, first - segment.due[0], step)
        yield self._piece(table, first, _stamps(stamp_of(block), np.arange(scans_of(block)), step), _values(block))

    def _gap(self, table: Table, begin: int, begin_ns: int, lost: int, step: float) -> Iterator[Piece]:
        """Yield `lost` rows of NaN from the index `begin` on, `step` [ns] apart."""
        table.gaps.append((begin, lost))
        for first in range(0, lost, _GAP):
            after = np.arange(first, min(first + _GAP, lost))
            nothing = np.full((len(after), len(table.columns) - 3), np.nan)
            yield self._piece(table, begin + first, _stamps(begin_ns, after, step), nothing)

    def _piece(self, table: Table, first: int, stamps: NDArray[np.int64], values: Array) -> Piece:
        table.rows += len(stamps)
        index = first + np.arange(len(stamps), dtype=np.int64)
        return Piece(table, ((stamps - self._start) * 1e-9, stamps, index, *np.ascontiguousarray(values.T)))

    def _channels(self, block: Decoded) -> Iterator[Column]:
        if hasattr(block, "beam"):
            yield from (Column(name, *self._known.get(name, ("m", ""))) for name in _SERIES)
            return
        taken: set[str] = {TIME, STAMP, INDEX}
        for place, name in enumerate(block.channels):
            unit = block.units[place] if place < len(block.units) else ""
            skew = float(block.skew[place]) if place < len(block.skew) else 0.0
            free = name if name not in taken else f"{name}_{place}"
            taken.add(free)
            yield Column(free, unit, f"channel {name} of {block.device}", skew=skew)


def _stamps(begin_ns: int, after: NDArray[np.int64], step: float) -> NDArray[np.int64]:
    """Return the stamps of samples (n,) `after` the one of `begin_ns`, `step` apart [ns]."""
    return np.asarray(begin_ns + np.rint(after * step).astype(np.int64))


def _values(block: Decoded) -> Array:
    """Return the samples (n, channels)."""
    if hasattr(block, "beam"):
        return np.column_stack([np.asarray(getattr(block, name), dtype=np.float64) for name in _SERIES])
    return np.asarray(block.data, dtype=np.float64).reshape(-1, len(block.channels))


def _array(values: Sequence[object], dtype: np.dtype[np.generic]) -> Values:
    array = np.empty(len(values), dtype)
    array[:] = list(values) if dtype == TEXT else values
    return array
