# SPDX-License-Identifier: Apache-2.0
"""One pass over a bag, piece by piece: memory does not grow with its length, and a bag that breaks off gives what is
there.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from atpid_common.errors import InputError
from atpid_common.message_checks import CHECKS, check_as
from atpid_control.bags.cut_off import Parts
from atpid_control.bags.decode import Decoder
from atpid_control.bags.errors import BagError
from atpid_control.bags.losses import scans_of
from atpid_control.bags.metadata import RESULT, RUN
from atpid_control.bags.read import stamp_of
from atpid_control.bags.records import records
from atpid_control.export.fields import Leaf, comments, has_header, leaves
from atpid_control.export.samples import Samples
from atpid_control.export.tables import RECEIVED, STAMP, TEXT, TIME, Column, Piece, Table, common

_OURS = "atpid_interfaces/msg/"
#: Messages with samples, and their fields that are series.
_SAMPLED = {"SampleBlock": ("channels", "units", "skew", "data"), "PlantTruth": ("support", "beam", "grain", "ceiling")}
#: Messages of one topic gathered to a piece.
_ROWS = 32


class ExportError(InputError):
    """A bag that cannot be exported as asked: what was given, what is allowed, what to do."""


@dataclass
class _Topic:
    """One topic while it is read: its messages as rows, and its samples where it has some."""

    kind: str  # of atpid_interfaces; empty: of another package
    definition: str
    stamped: bool
    leaves: list[Leaf]
    table: Table
    samples: Samples | None
    waiting: list[tuple[Any, ...]]

    def flush(self) -> Iterator[Piece]:
        """Yield the rows that wait."""
        if self.waiting:
            columns = zip(*self.waiting, strict=True)
            arrays = (_array(values, c.dtype) for values, c in zip(columns, self.table.columns, strict=True))
            yield Piece(self.table, tuple(arrays))
            self.waiting = []


class Source:
    """A bag to be read once; what it holds besides its tables is known when `pieces` has ended."""

    def __init__(self, path: Path | str, topics: Sequence[str] = ()) -> None:
        """Open the bag; `topics`: those wanted, all where none is named. Raises BagError, ExportError."""
        self.path = Path(path)
        self._parts = Parts(self.path)
        self._wanted = set(topics)
        self.run: dict[str, str] = {}
        self.result: dict[str, str] = {}
        self.files: dict[str, bytes] = {}
        self._topics: list[_Topic] = []
        self._foreign: dict[str, str] = {}  # topics that cannot be read: how they are encoded
        self.start_ns = self._first_sample()

    @property
    def tables(self) -> list[Table]:
        """The tables that have been met."""
        found = []
        for topic in self._topics:
            found += topic.samples.tables if topic.samples else []
            found += [topic.table] if topic.table.rows or topic.table.left_out else []
        return found

    def empty(self) -> ExportError:
        """Return the error of a bag from which nothing has come, with the reason where there is one."""
        lines = self.missing
        what = f"; {lines[0]}" if lines else ""
        return ExportError(f"{self.path}: no message in this bag can be used{what}; give one with a recording")

    @property
    def missing(self) -> list[str]:
        """What the bag does not have and should, a line each; known when `pieces` has ended."""
        lines = self._parts.missing
        for topic, encoding in self._foreign.items():
            lines.append(f"{topic}: left out, encoded as {encoding!r} or without a ros2msg definition")
        for table in self.tables:
            if table.lost:
                lines.append(f"{table.name}: {table.lost} samples lost in {len(table.gaps)} gaps; their rows are NaN")
            lines += [f"{table.name}: {count} messages left out: {why}" for why, count in table.left_out.items()]
        return lines

    def pieces(self) -> Iterator[Piece]:
        """Yield the rows of all tables wanted, as they come. Raises BagError, ExportError: a topic it does not have."""
        for file in self._parts.files:
            yield from self._file(file)
        for topic in self._topics:
            yield from topic.flush()
        unknown = sorted(self._wanted - set(self._parts.messages))
        if unknown:
            listed = ", ".join(sorted(self._parts.messages)) or "none"
            raise ExportError(f"{self.path}: --topic: given {unknown[0]}; in the bag: {listed}")

    def _file(self, file: Path) -> Iterator[Piece]:
        """Yield the rows of one file, with ids of its own."""
        decoder, definitions, channels = Decoder(), dict[int, str](), dict[int, tuple[Channel, _Topic | None]]()
        for record in self._parts.records(file):
            if isinstance(record, Schema):
                with suppress(BagError):  # of another encoding: its topics are left out
                    decoder.add(record)
                    definitions[record.id] = record.data.decode(errors="replace")
            elif isinstance(record, Channel) and record.id not in channels:
                known = record.message_encoding == "cdr" and record.schema_id in definitions
                channels[record.id] = record, self._topic(record, decoder, definitions) if known else None
                if not known:
                    self._foreign[record.topic] = record.message_encoding
            elif isinstance(record, Message) and record.channel_id in channels:
                channel, topic = channels[record.channel_id]
                if topic is not None:
                    message = decoder.decode(channel.schema_id, record.data)
                    yield from self._rows(topic, message, record.log_time)
            else:
                self._aside(record)

    def _aside(self, record: McapRecord) -> None:
        if isinstance(record, Attachment):
            self.files[record.name] = record.data
        elif isinstance(record, Metadata):
            {RUN: self.run, RESULT: self.result}.get(record.name, {}).update(record.metadata)

    def _first_sample(self) -> int:
        """Return the stamp of the bag's first sample, else of its first message [ns]."""
        decoder, channels, schemas = Decoder(), dict[int, int](), set[int]()
        first = None
        for record in records(self._parts.files[0], torn_ok=True):
            if isinstance(record, Schema):
                with suppress(BagError):
                    decoder.add(record)
                    schemas.add(record.id)
            elif isinstance(record, Channel) and record.message_encoding == "cdr" and record.schema_id in schemas:
                channels[record.id] = record.schema_id
            elif isinstance(record, Message) and record.channel_id in channels:
                name = decoder.name(channels[record.channel_id])
                message = decoder.decode(channels[record.channel_id], record.data)
                stamp = stamp_of(message) if has_header(decoder, name) else record.log_time
                if name.removeprefix(_OURS) in _SAMPLED and scans_of(message):
                    return stamp
                first = stamp if first is None else first
        return first or 0

    def _topic(self, channel: Channel, decoder: Decoder, definitions: dict[int, str]) -> _Topic | None:
        if self._wanted and channel.topic not in self._wanted:
            return None
        name, definition = decoder.name(channel.schema_id), definitions[channel.schema_id]
        same = [topic for topic in self._topics if topic.table.topic == channel.topic]
        for topic in same:
            if (topic.table.type, topic.definition) == (name, definition):
                return topic
        kind = name.removeprefix(_OURS) if name.startswith(_OURS) else ""
        series = _SAMPLED.get(kind, ())
        found = [leaf for leaf in leaves(decoder, name, definition) if leaf.path[0] not in series]
        own = channel.topic.strip("/") + (f"_definition_{len(same) + 1}" if same else "")
        samples = Samples(own, channel.topic, name, comments(definition), self.start_ns) if series else None
        scans = [Column("scans", "", "samples in the block", np.dtype(np.int64))] if series else []
        columns = (*common(TIME, STAMP, RECEIVED), *scans, *(leaf.column for leaf in found))
        table = Table(own + ("_blocks" if series else ""), channel.topic, name, columns)
        made = _Topic(kind, definition, has_header(decoder, name), found, table, samples, [])
        self._topics.append(made)
        return made

    def _rows(self, topic: _Topic, message: Any, log_ns: int) -> Iterator[Piece]:
        reason = check_as(topic.kind, message) if topic.kind in CHECKS else ""
        row: tuple[Any, ...] = ()
        if not reason:
            try:
                row = tuple(leaf.value(message) for leaf in topic.leaves)
            except AttributeError:  # the bag defines the type twice
                reason = "they lack a field of their type"
        if reason:
            topic.table.left_out[reason] = topic.table.left_out.get(reason, 0) + 1
            return
        stamp = stamp_of(message) if topic.stamped else log_ns
        times = ((stamp - self.start_ns) * 1e-9, stamp, (log_ns - self.start_ns) * 1e-9)
        scans = (scans_of(message),) if topic.samples else ()
        topic.waiting.append((*times, *scans, *row))
        topic.table.rows += 1
        if topic.samples:
            yield from topic.samples.rows(message)
        if len(topic.waiting) == _ROWS:
            yield from topic.flush()


def _array(values: Any, dtype: np.dtype[Any]) -> Any:
    array = np.empty(len(values), dtype)
    array[:] = list(values) if dtype == TEXT else values
    return array
