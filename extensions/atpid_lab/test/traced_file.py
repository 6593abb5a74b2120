# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A file of traces, read with public libraries and the definitions inside it."""

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_sim.system import Array


class Traced:
    """Types and decoded messages (log time [ns], message) of a file, by topic."""

    def __init__(self, file: Path) -> None:
        self.store = get_typestore(Stores.EMPTY)
        self.types: dict[str, str] = {}
        self.messages: dict[str, list[tuple[int, Any]]] = {}
        with file.open("rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False):
                assert schema is not None
                self._register(schema, channel)
                decoded = self.store.deserialize_cdr(message.data, schema.name)
                self.messages.setdefault(channel.topic, []).append((message.log_time, decoded))

    def _register(self, schema: Schema, channel: Channel) -> None:
        if channel.topic in self.types:
            return
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")  # what PlotJuggler's client takes
        types = get_types_from_msg(schema.data.decode(), schema.name)
        self.store.register({name: kind for name, kind in types.items() if name not in self.store.fielddefs})
        self.types[channel.topic] = schema.name

    def series(self, topic: str) -> tuple[Array, Array]:
        times, values = zip(*((time, message.data) for time, message in self.messages[topic]), strict=True)
        return np.array(times), np.array(values)
