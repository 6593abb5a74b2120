# SPDX-License-Identifier: Apache-2.0
"""Blocks of samples as rows: every index has its row, a lost one with NaN, so that nothing is joined over a gap."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from atpid_control.bags.losses import scans_of
from atpid_control.bags.read import stamp_of
from atpid_control.export.tables import INDEX, STAMP, TIME, Column, Piece, Table, common
from atpid_sim.system import Array

#: Longest gap that is filled with rows [s]; an index farther ahead is none. Lost samples of a table, at most.
_LONGEST_GAP, _MOST_LOST = 3600.0, 20_000_000
#: Rows of a gap in one piece, and streams of one topic that are told apart.
_ROWS, _MOST_PARTS = 65536, 20
#: Series of the simulated plant.
_SERIES = ("support", "beam", "grain", "ceiling")


class Samples:
    """The rows of one topic of SampleBlock or PlantTruth; a stream that starts anew makes a table of its own."""

    def __init__(self, name: str, topic: str, type_name: str, known: dict[str, tuple[str, str]], start_ns: int) -> None:
        self.tables: list[Table] = []
        self._name, self._topic, self._type, self._known, self._start = name, topic, type_name, known, start_ns
        self._following = 0  # index the next block should have
        self._end_ns = 0  # instant of that index by the block before

    def rows(self, block: Any) -> Iterator[Piece]:
        """Yield the rows of a block, those of the samples lost before it first."""
        first, count, rate = int(block.first_index), scans_of(block), float(block.rate)
        if not count:
            return
        columns = self._columns(block)
        table = self.tables[-1] if self.tables else None
        if table is None or self._starts_anew(table, first, rate, columns, stamp_of(block)):
            if len(self.tables) == _MOST_PARTS:
                self._leave_out(f"the stream starts anew for the {_MOST_PARTS}th time")
                return
            name = self._name + (f"_{len(self.tables) + 1}" if self.tables else "")
            table = Table(name, self._topic, self._type, columns, rate)
            self.tables.append(table)
        elif first < self._following:
            self._leave_out(f"a block goes back to index {first} after {self._following - 1}")
            return
        elif first > self._following:
            yield from self._gap(table, first)
        stamps = stamp_of(block) + np.rint(np.arange(count) * (1e9 / rate)).astype(np.int64)
        yield self._piece(table, first, stamps, _values(block))
        self._following = first + count
        self._end_ns = stamp_of(block) + round(count / rate * 1e9)

    def _starts_anew(self, table: Table, first: int, rate: float, columns: tuple[Column, ...], stamp_ns: int) -> bool:
        # a counter that goes back while time goes on was started anew; the first blocks of it may be lost
        again = first < self._following and (first == 0 or stamp_ns > self._end_ns - round(0.5e9 / rate))
        ahead = first - self._following
        jump = ahead > _LONGEST_GAP * rate or ahead + table.lost > _MOST_LOST
        return again or jump or rate != table.rate or columns != table.columns

    def _leave_out(self, reason: str) -> None:
        reasons = self.tables[-1].left_out
        reasons[reason] = reasons.get(reason, 0) + 1

    def _gap(self, table: Table, until: int) -> Iterator[Piece]:
        """Yield rows of NaN up to the index `until`."""
        table.gaps.append((self._following, until - self._following))
        begin, step = self._following, 1e9 / (table.rate or 1.0)
        for first in range(begin, until, _ROWS):
            count = min(_ROWS, until - first)
            stamps = self._end_ns + np.rint((first - begin + np.arange(count)) * step).astype(np.int64)
            width = len(table.columns) - 3
            yield self._piece(table, first, stamps, np.full((count, width), np.nan))

    def _piece(self, table: Table, first: int, stamps: Any, values: Array) -> Piece:
        table.rows += len(stamps)
        index = first + np.arange(len(stamps), dtype=np.int64)
        return Piece(table, ((stamps - self._start) * 1e-9, stamps, index, *np.ascontiguousarray(values.T)))

    def _columns(self, block: Any) -> tuple[Column, ...]:
        return (*common(TIME, STAMP, INDEX), *self._channels(block))

    def _channels(self, block: Any) -> Iterator[Column]:
        if hasattr(block, "beam"):
            yield from (Column(name, *self._known.get(name, ("m", ""))) for name in _SERIES)
            return
        taken: set[str] = {TIME, STAMP, INDEX}
        for place, name in enumerate(block.channels):
            unit = block.units[place] if place < len(block.units) else ""
            skew = float(block.skew[place]) if place < len(block.skew) else 0.0
            free = name if name not in taken else f"{name}_{place}"
            taken.add(free)
            yield Column(free, unit, f"channel {name} of {block.header.frame_id}", skew=skew)


def _values(block: Any) -> Array:
    """Return the samples (n, channels)."""
    if hasattr(block, "beam"):
        return np.column_stack([np.asarray(getattr(block, name), dtype=np.float64) for name in _SERIES])
    return np.asarray(block.data, dtype=np.float64).reshape(-1, len(block.channels))
