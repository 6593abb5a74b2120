# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decodes messages with the schemas inside the bag, and converts them to the definitions installed."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, TypeAlias

from mcap.records import Schema
from rosbags.convert.converter import default_message
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from atpid_control.runs.errors import BagError, TypeUnknownError

#: A decoded message: fields by name, number sequences as arrays. The bag's definitions state which it has.
Decoded: TypeAlias = Any
#: A field's type, as rosbags describes it: of which kind, and what. The fields of a message type by name.
Described: TypeAlias = tuple[Nodetype, Any]
Fields: TypeAlias = dict[str, Described]

_SEPARATOR = "=" * 80
_INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_PRIMITIVES = _INTEGERS | {"bool", "byte", "char", "string", "wstring", "float32", "float64"}
_FIELD = re.compile(r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?:\[(?:<=)?\d*\])?\s+\w+(?!\w|\s*=)")  # not a constant
_HANDSHAKE = re.compile(r"^std_msgs/Header +header\b.*\nbool +handshake\b", re.MULTILINE)


@dataclass(frozen=True)
class MessageType:
    """One message type with everything a reader without the workspace needs."""

    name: str  # pkg/msg/Name
    definition: str  # its .msg file and, after separators, those of all types inside it
    hash: str  # RIHS01_...
    has_header: bool  # the first field is a std_msgs/Header, so that the stamp is at a known place
    has_handshake: bool  # and the second is `bool handshake`


@cache
def message_type(name: str) -> MessageType:
    """Return the type `name` ("pkg/msg/Name") of an installed package; raise TypeUnknownError where there is none."""
    text = _text_of(name, ".msg")
    parts, seen, waiting = [text], {name}, list(_inside(name, text))
    while waiting:
        inner = waiting.pop(0)
        if inner in seen:
            continue
        seen.add(inner)
        inner_text = _text_of(inner, ".msg")
        parts += [_SEPARATOR, f"MSG: {inner.replace('/msg/', '/')}", inner_text]
        waiting += _inside(inner, inner_text)
    has_header = next(_inside(name, text, all_fields=True), "") == "std_msgs/msg/Header"
    has_handshake = has_header and _HANDSHAKE.search(text) is not None
    described = json.loads(_text_of(name, ".json"))
    type_hash = next(str(entry["hash_string"]) for entry in described["type_hashes"] if entry["type_name"] == name)
    return MessageType(name, "\n".join(parts), type_hash, has_header, has_handshake)


def split_name(name: str) -> tuple[str, str]:
    """Return package and message of "pkg/msg/Name"; raise TypeUnknownError for anything else."""
    parts = name.split("/")
    if len(parts) != 3 or parts[1] != "msg" or not all(parts):
        allowed = "pkg/msg/Name, as `ros2 interface list` prints it"
        raise TypeUnknownError(f"message type: given {name!r}; allowed: {allowed}")
    return parts[0], parts[2]


def _text_of(name: str, suffix: str) -> str:
    # imported here: reading a bag needs neither ROS nor a workspace
    from ament_index_python.packages import get_package_share_directory

    package, message = split_name(name)
    try:
        path = Path(get_package_share_directory(package)) / "msg" / f"{message}{suffix}"
    except (LookupError, OSError):
        what = f"the package {package} is not in this shell: source its workspace"
        raise TypeUnknownError(f"message type {name}: {what}") from None
    if not path.is_file():
        what = f"{package} has no such message; look at `ros2 interface package {package}`"
        raise TypeUnknownError(f"message type {name}: {what}")
    return path.read_text(encoding="utf-8")


def _inside(name: str, text: str, all_fields: bool = False) -> Iterator[str]:
    """Yield the full names of the message types among the fields of `text` (primitives too with `all_fields`)."""
    package, _ = split_name(name)
    for line in text.splitlines():
        field = _FIELD.match(line.split("#", 1)[0].strip())
        if field and field["type"] not in _PRIMITIVES:
            parts = field["type"].split("/")
            yield f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}"
        elif field and all_fields:
            yield field["type"]


#: Encapsulations of plain CDR: big- and little-endian.
_CDR = (b"\x00\x00", b"\x00\x01")
#: Bytes that may follow the last field: up to 3 that fill a word, and before an empty array of doubles 4 more.
_PADDING = 7


#: What messages carried as `header.frame_id` before version 1.1: their device or node, by their type.
_NAMED = (("SampleBlock", "device"), ("Excitation", "device"), ("Event", "node"))
_MOVED = {f"atpid_interfaces/msg/{name}": field for name, field in _NAMED}
#: Longest definition [bytes]; those of ROS with all they contain have some thousand.
_MOST_BYTES = 100_000


@lru_cache(maxsize=256)
def _store_of(name: str, definition: bytes) -> Typestore:
    """Return the types of a definition: bags have the same ones, and to read and compile them takes milliseconds."""
    if len(definition) > _MOST_BYTES:
        raise BagError(f"{len(definition)} bytes; allowed: {_MOST_BYTES}")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition.decode(), name))
    store.get_msgdef(name)  # raises where a type inside is not defined
    return store


class Decoder:
    """Message types by schema id."""

    def __init__(self) -> None:
        self._stores: dict[int, Typestore] = {}
        self._schemas: dict[int, Schema] = {}
        self.moved: dict[int, str] = {}  # by schema, the field that is taken from `header.frame_id`
        self._fields: Typesdict = {}  # of each type, the first definition of it

    def add(self, schema: Schema) -> None:
        """Register the types of one schema; raise BagError where it is not a ROS 2 message definition."""
        if schema.id in self._schemas:
            return
        if schema.encoding != "ros2msg":
            allowed = "ros2msg, as recorder_node writes it"
            raise BagError(f"schema {schema.name}: encoding {schema.encoding!r}; allowed: {allowed}")
        try:
            store = _store_of(schema.name, schema.data)
            self._fields = {**store.fielddefs, **self._fields}
        except Exception as error:  # the library raises many types of errors for what is no definition
            reason = " ".join(str(error).split())[:80] or type(error).__name__
            raise BagError(f"the definition of {schema.name[:80]!r} cannot be read ({reason})") from None
        self._schemas[schema.id], self._stores[schema.id] = schema, store
        moved = _MOVED.get(schema.name, "")
        if moved and moved not in self.fields(schema.name, schema.id):
            self.moved[schema.id] = moved

    def name(self, schema_id: int) -> str:
        """Return the message type of a schema; raise BagError where the bag does not have it."""
        if schema_id not in self._schemas:
            raise BagError(f"the definition {schema_id} of a topic's messages is not in the bag: it is damaged")
        return str(self._schemas[schema_id].name)

    def decode(self, schema_id: int, data: bytes) -> Decoded:
        """Return the message: fields by name, number sequences as arrays; raise BagError where the bytes do not fit."""
        name = self.name(schema_id)
        try:
            message = _deserialised(data, name, self._stores[schema_id])
            if schema_id in self.moved:
                setattr(message, self.moved[schema_id], message.header.frame_id)
        except Exception as error:  # the generated code raises many types of errors for damaged bytes
            raise BagError(f"a message of type {name} cannot be decoded ({error}): the bag is damaged") from None
        return message

    def definition_of(self, schema_id: int) -> bytes:
        """Return the definition of one schema."""
        return bytes(self._schemas[schema_id].data)

    def definition(self, name: str) -> bytes:
        """Return the first definition of a topic's message type and, after separators, those of all types inside it."""
        return next(bytes(schema.data) for schema in self._schemas.values() if schema.name == name)

    def fields(self, name: str, schema_id: int | None = None) -> Fields:
        """Return the fields of a message type, as rosbags describes them, by their names in the message's order.

        By the definitions of one schema, or by the bag's first one of the type. Raises BagError where there is none.
        """
        known = self._fields if schema_id is None else self._stores[schema_id].fielddefs
        if name not in known:
            raise BagError(f"the definition of {name[:80]!r} is of another type: the bag is damaged")
        return dict(known[name][1])


def _deserialised(data: bytes, name: str, store: Typestore) -> Decoded:
    encapsulation = bytes(data[:2])
    if len(data) < 4 or encapsulation not in _CDR:
        raise ValueError("it is not plain CDR")
    definition = store.get_msgdef(name)
    read = definition.deserialize_cdr_le if encapsulation[1] else definition.deserialize_cdr_be
    message, end = read(data[4:], 0, definition.cls, store)
    if len(data) - 4 - end > _PADDING:
        raise ValueError("it is longer than its definition")
    return message


def is_handshake(data: bytes) -> bool:
    """Return the bool after the header of a message whose second field is `bool handshake`; one cut short has none.

    The length of frame_id is a little-endian uint32 at 12, its characters, with a zero at their end, begin at 16.
    """
    place = 16 + int.from_bytes(data[12:16], "little")
    return data[1:2] == b"\x01" and data[place : place + 1] == b"\x01"


def scans_of(block: Decoded) -> int:
    """Return how many scans a SampleBlock or PlantTruth has."""
    return len(block.support) if hasattr(block, "support") else len(block.data) // len(block.channels)


def stamp_of(message: Decoded) -> int:
    """Return the stamp in the header of a decoded message [ns]."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


class Converter:
    """Serialises messages of one type anew. `missing`: fields the bag does not have, which keep their defaults;
    `moved`: those it has as `header.frame_id`; `dropped`: fields of the bag the installed type does not have.
    """

    def __init__(self, name: str, decoder: Decoder) -> None:
        """Compare the definitions of `name` in the bag and installed.

        Raises BagError where a field has another type, TypeUnknownError where the package is not installed.
        """
        self._name = name
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(get_types_from_msg(message_type(name).definition, name))
        self._installed: dict[str, Fields] = {key: dict(fields) for key, (_, fields) in self._store.fielddefs.items()}
        self._recorded = decoder
        self.moved: list[str] = []
        self.missing: list[str] = []
        self.dropped: list[str] = []
        #: Whether both definitions have the same fields in the same order, so that nothing has to be converted.
        self.identical = True
        self._compare(name, "")

    def convert(self, message: Decoded) -> bytes:
        """Return a decoded message of the bag, serialised by the definition installed. Raises BagError."""
        try:
            return bytes(self._store.serialize_cdr(self._filled(self._name, message), self._name))
        except (ValueError, TypeError, AssertionError) as error:
            raise BagError(f"a message of type {self._name} cannot be converted: {error}") from None

    def _compare(self, name: str, path: str) -> None:
        """Collect what differs in the type `name`, which stands at `path` of the message."""
        recorded = self._recorded.fields(name)
        installed = self._installed[name]
        self.identical &= list(installed.items()) == list(recorded.items())
        absent = [field for field in installed if field not in recorded]
        self.moved += [field for field in absent if field == _MOVED.get(name)]
        self.missing += [f"{path}{field}" for field in absent if field != _MOVED.get(name)]
        self.dropped += [f"{path}{field}" for field in recorded if field not in installed]
        for field, described in installed.items():
            if field not in recorded:
                continue
            if recorded[field] != described:
                before, now = _words(recorded[field]), _words(described)
                raise BagError(f"field {path}{field} of {name} was recorded as {before}, installed is {now}")
            if inner := _inner(described):
                self._compare(inner, f"{path}{field}.")

    def _filled(self, name: str, recorded: Decoded) -> Decoded:
        """Return a message of the installed type `name` with the values of `recorded`, defaults where it has none."""
        defaults = default_message(self._store, name)
        values = {}
        for field, (kind, described) in self._installed[name].items():
            given = getattr(recorded, field, None)
            if given is None:
                values[field] = getattr(defaults, field)
            elif kind == Nodetype.NAME:
                values[field] = self._filled(described, given)
            elif _inner((kind, described)):
                values[field] = [self._filled(described[0][1], item) for item in given]
            else:
                values[field] = given
        return self._store.types[name](**values)


def _inner(described: Described) -> str:
    """Return the message type of a field, or of an array's elements; empty: a primitive."""
    kind, rest = described
    if kind == Nodetype.NAME:
        return str(rest)
    return _inner(rest[0]) if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else ""


def _words(described: Described) -> str:
    """Return a field's type as a message file writes it."""
    kind, rest = described
    if kind in (Nodetype.BASE, Nodetype.NAME):
        return str(rest if kind == Nodetype.NAME else rest[0])
    element, count = rest
    return f"{_words(element)}[{count or ''}]"
