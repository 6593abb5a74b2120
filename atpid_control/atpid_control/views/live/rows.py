# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rows of numbers over time, bounded: those of the last seconds, and those not yet sent to the browsers."""

import math
from collections import deque
from collections.abc import Sequence

Row = tuple[float | None, ...]
#: Digits after the point that are sent: 1 ns, 1 nm, 1 nHz.
_DIGITS = 9


def plain(value: float) -> float | None:
    """Return a number as JSON can hold it: rounded; None for NaN and infinity."""
    return round(float(value), _DIGITS) if math.isfinite(value) else None


class Rows:
    """Rows (time [s], values...) in the order they came, one in `spacing` [s] at most; a row of None is a gap."""

    def __init__(self, kept: int, spacing: float = 0.0, longest: float = math.inf) -> None:
        """Keep the last `kept` rows; leave out those that follow the one before by less than `spacing` [s].

        More than `longest` [s] between two rows is a gap.
        """
        self._longest = longest
        self._rows: deque[Row] = deque(maxlen=kept)
        self._new: deque[Row] = deque(maxlen=kept)
        self._spacing, self._last = spacing, -math.inf

    def add(self, time: float, *values: float) -> bool:
        """Add a row, where it is due; return whether it was."""
        if time < self._last + self._spacing:
            return False
        if time > self._last + self._longest:
            self.add_gap(self._last + self._longest)
        self._last = time
        row = (plain(time), *map(plain, values))
        self._append(row)
        return True

    def add_gap(self, time: float) -> None:
        """Draw no line over this time [s], which lies between the last row and the next."""
        if self._rows:
            self._append((plain(time), *(None for _ in self._rows[-1][1:])))

    def _append(self, row: Row) -> None:
        self._rows.append(row)
        self._new.append(row)

    def all(self) -> Sequence[Row]:
        """Return all rows that are kept, sent or not."""
        return list(self._rows)

    def take(self) -> Sequence[Row]:
        """Return the rows that came since the last call."""
        taken = list(self._new)
        self._new.clear()
        return taken

    def clear(self) -> None:
        """Forget everything."""
        self._rows.clear()
        self._new.clear()
        self._last = -math.inf
