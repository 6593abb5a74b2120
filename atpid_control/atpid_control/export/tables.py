# SPDX-License-Identifier: Apache-2.0
"""What the tables of a bag are: columns with units, one table for each stream of samples and each topic."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Type of a column of texts.
TEXT = np.dtype(object)
#: Columns every table begins with. `time` is what one plots over; `stamp` is exact.
TIME, STAMP, RECEIVED, INDEX = "time", "stamp", "received", "index"


@dataclass(frozen=True)
class Column:
    """One column: its name, SI unit (empty: none), what it is, and the type of its values."""

    name: str
    unit: str
    description: str
    dtype: np.dtype[Any] = field(default_factory=lambda: np.dtype(np.float64))
    skew: float = 0.0  # delay of the channel's sampling instants after `time` [s]


_COMMON = {
    TIME: Column(TIME, "s", "hardware time since the first sample of the bag"),
    STAMP: Column(STAMP, "ns", "hardware time since 1970, or since the start of a simulation", np.dtype(np.int64)),
    RECEIVED: Column(RECEIVED, "s", "when the recorder received the message, on the axis of `time`"),
    INDEX: Column(INDEX, "", "index of the sample, from the start of its stream", np.dtype(np.int64)),
}


def common(*names: str) -> tuple[Column, ...]:
    """Return the columns of these names that tables have in common."""
    return tuple(_COMMON[name] for name in names)


@dataclass
class Table:
    """One table, and what is known of it once the bag has been read."""

    name: str  # the topic without its first slash, such as sensors/laser
    topic: str
    type: str  # of the messages
    columns: tuple[Column, ...]
    rate: float | None = None  # of the samples [Hz]; None: a row for each message
    rows: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)  # (first index, how many samples) that were lost
    left_out: dict[str, int] = field(default_factory=dict)  # messages that cannot be used: how many, by reason

    @property
    def lost(self) -> int:
        """How many samples were lost, by index; their rows are there, with NaN."""
        return sum(count for _, count in self.gaps)

    @property
    def values(self) -> tuple[Column, ...]:
        """The columns that hold what was measured or published."""
        return tuple(column for column in self.columns if column.name not in (TIME, STAMP, INDEX))

    def about(self) -> dict[str, Any]:
        """Return what is not in the columns, as plain values."""
        return {
            "topic": self.topic, "type": self.type, **({} if self.rate is None else {"rate": self.rate}),
            "lost": self.lost, "gap_first_index": [first for first, _ in self.gaps],
            "gap_samples": [count for _, count in self.gaps],
            "left_out": sum(self.left_out.values()), "left_out_reasons": sorted(self.left_out),
        }  # fmt: skip


@dataclass(frozen=True)
class Piece:
    """Rows of a table: one array (k,) a column."""

    table: Table
    arrays: tuple[NDArray[Any], ...]

    def __len__(self) -> int:
        return len(self.arrays[0])
