# SPDX-License-Identifier: Apache-2.0
"""Decodes messages with the schemas inside the bag: neither ROS nor the workspace is needed."""

from __future__ import annotations

from typing import Any

from mcap.records import Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.bags.errors import BagError

#: Encapsulations of plain CDR: big- and little-endian.
_CDR = (b"\x00\x00", b"\x00\x01")
#: Bytes that may follow the last field: up to 3 that fill a word, and before an empty array of doubles 4 more.
_PADDING = 7


class Decoder:
    """Message types by schema id."""

    def __init__(self) -> None:
        """Start without types."""
        self._store = get_typestore(Stores.EMPTY)
        self._names: dict[int, str] = {}

    def add(self, schema: Schema) -> None:
        """Register the types of one schema; raise BagError where it is not a ROS 2 message definition."""
        if schema.id in self._names:
            return
        if schema.encoding != "ros2msg":
            raise BagError(
                f"schema {schema.name}: encoding {schema.encoding!r}; allowed: ros2msg, as recorder_node writes it"
            )
        types = get_types_from_msg(schema.data.decode(), schema.name)
        self._store.register({name: found for name, found in types.items() if name not in self._store.fielddefs})
        self._names[schema.id] = schema.name

    def name(self, schema_id: int) -> str:
        """Return the message type of a schema."""
        return self._names[schema_id]

    def decode(self, schema_id: int, data: bytes) -> Any:
        """Return the message: fields by name, number sequences as arrays; raise BagError where the bytes do not fit."""
        name = self._names[schema_id]
        try:
            return self._deserialised(data, name)
        except Exception as error:  # the generated code raises many types of errors for damaged bytes
            raise BagError(f"a message of type {name} cannot be decoded ({error}): the bag is damaged") from None

    def fields(self, name: str) -> dict[str, Any]:
        """Return the fields of a message type, as rosbags describes them, by their names in the message's order."""
        return dict(self._store.fielddefs[name][1])

    def _deserialised(self, data: bytes, name: str) -> Any:
        encapsulation = bytes(data[:2])
        if len(data) < 4 or encapsulation not in _CDR:
            raise ValueError("it is not plain CDR")
        definition = self._store.get_msgdef(name)
        read = definition.deserialize_cdr_le if encapsulation[1] else definition.deserialize_cdr_be
        message, end = read(data[4:], 0, definition.cls, self._store)
        if len(data) - 4 - end > _PADDING:
            raise ValueError("it is longer than its definition")
        return message
