# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the tables of a bag are: columns with units, one table for each stream of samples and each topic.

Fields of a message are columns: nested ones with dots, sequences as JSON, units from the definition's comments.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from atpid_common.files import Document
from atpid_control.runs.decode import Decoded, Decoder, Fields

#: The values (k,) of a column, of any type; those of a table by its columns' names.
Values: TypeAlias = NDArray[Any]
Columns: TypeAlias = dict[str, Values]
#: Type of a column of texts.
TEXT = np.dtype(object)
#: Origin of the simulated plant's own motion; sensors have the last word of their topic, such as `laser`.
TRUTH = "truth"
#: Columns every table begins with. `time` is what one plots over; `stamp` is exact.
TIME, STAMP, RECEIVED, INDEX = "time", "stamp", "received", "index"


@dataclass(frozen=True)
class Column:
    """One column: its name, SI unit (empty: none), what it is, and the type of its values."""

    name: str
    unit: str
    description: str
    dtype: np.dtype[np.generic] = field(default_factory=lambda: np.dtype(np.float64))
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
    begin: float = 0.0  # time of the first sample, from where the others follow by index and rate [s]
    jump: str = ""  # how the index of its first sample follows on that of the table before; empty: there is none
    first_index: int = 0  # of the first sample
    rows: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)  # (first index, how many samples) that were lost
    left_out: Counter[str] = field(default_factory=Counter)  # messages that cannot be used: how many, by reason

    @property
    def lost(self) -> int:
        """How many samples were lost, by index; their rows are there, with NaN."""
        return sum(count for _, count in self.gaps)

    @property
    def origin(self) -> str:
        """Where samples come from: `truth`, the simulated plant's own motion, or the last word of a sensor's topic."""
        return TRUTH if self.type.endswith("/PlantTruth") else self.topic.rpartition("/")[2]

    @property
    def values(self) -> tuple[Column, ...]:
        """The columns that hold what was measured or published."""
        return tuple(column for column in self.columns if column.name not in (TIME, STAMP, INDEX))

    def about(self) -> Document:
        """Return what is not in the columns, as plain values."""
        rate = {} if self.rate is None else {"rate": self.rate}
        firsts, counts = ([gap[place] for gap in self.gaps] for place in (0, 1))
        gaps = {"lost": self.lost, "gap_first_index": firsts, "gap_samples": counts}
        left_out = {"left_out": self.left_out.total(), "left_out_reasons": sorted(self.left_out)}
        return {"topic": self.topic, "type": self.type, **rate, **gaps, **left_out}


@dataclass(frozen=True)
class Piece:
    """Rows of a table: one array (k,) a column."""

    table: Table
    arrays: tuple[Values, ...]

    def __len__(self) -> int:
        return len(self.arrays[0])


#: A field in a definition: type, name, comment. A constant has `=` after its name.
_FIELD = re.compile(r"^[\w/\[\]<=]+\s+(\w+)\s*(?:#\s*(.*))?$")
_UNIT = re.compile(r"\[([^\]\s]{1,12})\]")
_HEADER = "std_msgs/msg/Header"
#: Never recorded as true.
_HANDSHAKE = "handshake"
_NUMBERS = {f"{sign}int{bits}": getattr(np, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)}
_NUMBERS |= {"bool": np.bool_, "byte": np.uint8, "char": np.uint8, "float32": np.float32, "float64": np.float64}


def comments(definition: str) -> dict[str, tuple[str, str]]:
    """Return (unit, comment) of each field of a message definition; an empty unit: none is stated."""
    own = re.split(r"^=+$", definition, maxsplit=1, flags=re.MULTILINE)[0]  # definitions of contained types follow
    found = {}
    for line in own.splitlines():
        match = _FIELD.match(line.strip())
        if match:
            text = match[2] or ""
            unit = _UNIT.search(text)
            found[match[1]] = ("" if unit is None or unit[1] == "-" else unit[1], text)
    return found


@dataclass(frozen=True)
class Leaf:
    """One column of a message: the path to its value, and how the value is kept."""

    path: tuple[str, ...]
    column: Column

    def value(self, message: Decoded) -> object:
        """Return the value in a decoded message; a sequence as JSON."""
        for name in self.path:
            message = getattr(message, name)
        return message if self.column.dtype != TEXT or isinstance(message, str) else json.dumps(_plain(message))


def leaves(decoder: Decoder, schema_id: int, known: dict[str, tuple[str, str]]) -> list[Leaf]:
    """Return the columns of a message type, without header and handshake.

    known: unit and comment of its fields, as `comments` returns them.
    """
    fields = partial(decoder.fields, schema_id=schema_id)
    moved = [decoder.moved[schema_id]] if schema_id in decoder.moved else []
    found = [Leaf((name,), Column(name, "", "as published", TEXT)) for name in moved]
    return [*found, *_leaves(fields, decoder.name(schema_id), known, ())]


def has_header(decoder: Decoder, schema_id: int) -> bool:
    """Whether messages of this type begin with a header, and so have a stamp."""
    return decoder.fields(decoder.name(schema_id), schema_id).get("header") == (Nodetype.NAME, _HEADER)


def _leaves(
    fields: Callable[[str], Fields], type_name: str, known: dict[str, tuple[str, str]], path: tuple[str, ...]
) -> Iterator[Leaf]:
    for name, (kind, described) in fields(type_name).items():
        unit, text = known.get((*path, name)[0], ("", ""))
        place = (*path, name)
        if not path and name == "header" and described == _HEADER:
            yield Leaf(("header", "frame_id"), Column("frame", "", "what the values belong to", TEXT))
        elif not path and name == _HANDSHAKE:
            continue
        elif kind == Nodetype.NAME:
            yield from _leaves(fields, str(described), known, place)
        else:
            base = str(described[0]) if kind == Nodetype.BASE else ""
            yield Leaf(place, Column(".".join(place), unit, text, np.dtype(_NUMBERS.get(base, object))))


def _plain(value: object) -> object:
    """Return a field's value as JSON takes it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: _plain(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    return value
