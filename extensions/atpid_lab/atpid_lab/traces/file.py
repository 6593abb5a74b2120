# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag once more, with its traces: an MCAP file that Foxglove and PlotJuggler open and plot."""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.writer import CompressionType, Writer

from atpid_common.message_checks import CHECKS, check_as
from atpid_common.output import writing
from atpid_control.runs.metadata import RUN
from atpid_control.runs.read import Bag
from atpid_lab.traces.records import TraceRecord, definition
from atpid_lab.traces.tracer import TraceError, Tracer
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml

_OWN = "atpid_interfaces/msg/"


@dataclass
class Written:
    """What is in the file."""

    messages: dict[str, int] = field(default_factory=dict)  # by topic
    left_out: int = 0  # messages of the bag that cannot be used, and are copied but not traced


def write_traces(bag: Bag, file: Path, rate: float = math.inf) -> Written:
    """Write all messages of the bag and their traces, at most `rate` samples a second; return what was written.

    Raises BagError for a damaged bag, SceneError for a scene in it that is none, OutputError.
    """
    written, part = Written(), file.with_name(f"{file.name}.part")
    with writing(file):
        try:
            with part.open("wb") as stream:
                target = _Target(Writer(stream, compression=CompressionType.ZSTD), bag, written)
                for record in _records(bag, Tracer(scene_of(bag), rate), written):
                    target.add(record)
                target.finish()
            os.replace(part, file)
        finally:
            part.unlink(missing_ok=True)
    return written


def scene_of(bag: Bag) -> Scene | None:
    """Return the scene kept in the bag, None where there is none; raise BagError or SceneError for what is none."""
    text = bag.scene_text
    return None if text is None else scene_from_mapping(read_yaml(text, str(bag.path)), f"{bag.path}: scene")


def _records(bag: Bag, tracer: Tracer, written: Written) -> Iterator[TraceRecord]:
    for raw in bag.raw:
        kind = bag.types[raw.topic]
        yield TraceRecord(raw.topic, kind, raw.log_ns, raw.data)
        name = kind.removeprefix(_OWN)
        if name == kind or name not in CHECKS:
            continue
        message = bag.decode(raw)
        if check_as(name, message):
            written.left_out += 1
            continue
        try:
            yield from tracer.push(name, message)
        except TraceError:
            written.left_out += 1


class _Target:
    """An MCAP file in the profile of ROS 2, its definitions inside."""

    def __init__(self, writer: Writer, bag: Bag, written: Written) -> None:
        self._writer, self._bag, self._written = writer, bag, written
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        writer.start(profile="ros2", library="atpid_control")
        writer.add_metadata(RUN, bag.run)

    def add(self, record: TraceRecord) -> None:
        """Append one message."""
        if record.topic not in self._channels:
            self._channels[record.topic] = self._writer.register_channel(record.topic, "cdr", self._schema(record))
        count = self._written.messages.get(record.topic, 0)
        self._writer.add_message(self._channels[record.topic], record.time_ns, record.data, record.time_ns, count)
        self._written.messages[record.topic] = count + 1

    def finish(self) -> None:
        """Write the index."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _schema(self, record: TraceRecord) -> int:
        if record.type not in self._schemas:
            own = record.topic in self._bag.types
            text = self._bag.decoder.definition(record.type) if own else definition(record.type)
            self._schemas[record.type] = self._writer.register_schema(record.type, "ros2msg", text)
        return self._schemas[record.type]
