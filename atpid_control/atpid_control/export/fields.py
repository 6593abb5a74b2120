# SPDX-License-Identifier: Apache-2.0
"""Fields of a message as columns: nested ones with dots, sequences as JSON, units from the definition's comments."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from atpid_control.bags.decode import Decoder
from atpid_control.export.tables import TEXT, Column

#: A field in a definition: type, name, comment. A constant has `=` after its name.
_FIELD = re.compile(r"^[\w/\[\]<=]+\s+(\w+)\s*(?:#\s*(.*))?$")
_UNIT = re.compile(r"\[([^\]\s]{1,12})\]")
_HEADER = "std_msgs/msg/Header"
#: Never recorded as true.
_HANDSHAKE = "handshake"
_NUMBERS = {
    "bool": np.bool_, "byte": np.uint8, "char": np.uint8, "float32": np.float32, "float64": np.float64,
    **{f"{sign}int{bits}": getattr(np, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}  # fmt: skip


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

    def value(self, message: Any) -> Any:
        """Return the value in a decoded message; a sequence as JSON."""
        for name in self.path:
            message = getattr(message, name)
        return message if self.column.dtype != TEXT or isinstance(message, str) else json.dumps(_plain(message))


def leaves(decoder: Decoder, type_name: str, definition: str) -> list[Leaf]:
    """Return the columns of a message type, without header and handshake; the header's `frame_id` is `source`."""
    return list(_leaves(decoder, type_name, comments(definition), ()))


def has_header(decoder: Decoder, type_name: str) -> bool:
    """Whether messages of this type begin with a header, and so have a stamp."""
    return decoder.fields(type_name).get("header") == (Nodetype.NAME, _HEADER)


def _leaves(
    decoder: Decoder, type_name: str, known: dict[str, tuple[str, str]], path: tuple[str, ...]
) -> Iterator[Leaf]:
    for name, (kind, described) in decoder.fields(type_name).items():
        unit, text = known.get((*path, name)[0], ("", ""))
        place = (*path, name)
        if not path and name == "header" and described == _HEADER:
            source = Column("source", "", "node or device that published it", TEXT)
            yield Leaf(("header", "frame_id"), source)
        elif not path and name == _HANDSHAKE:
            continue
        elif kind == Nodetype.NAME:
            yield from _leaves(decoder, str(described), known, place)
        else:
            base = str(described[0]) if kind == Nodetype.BASE else ""
            yield Leaf(place, Column(".".join(place), unit, text, np.dtype(_NUMBERS.get(base, object))))


def _plain(value: Any) -> Any:
    """Return a field's value as JSON takes it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: _plain(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    return value
