# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag once more, with its traces: an MCAP file that Foxglove and PlotJuggler open and plot."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_common.message_checks import CHECKS, check_as
from atpid_common.output import writing
from atpid_common.vocabulary import DRIVES, Mode, Quality, RunState
from atpid_control.runs.decode import scans_of, stamp_of
from atpid_control.runs.metadata import RUN
from atpid_control.runs.read import Bag
from atpid_lab.traces.records import LOG, TEXT, Pose, TraceRecord, class_of, damper, definition, message, number
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.quantities import efficiency

if TYPE_CHECKING:
    from atpid_interfaces.msg import CeilingState, Event, Excitation, PlantTruth, SampleBlock, SupervisorState

#: Pictures of the damper a second, as far as the rate of the samples can be divided.
PICTURES = 25.0
_DRIVES = {drive.channel for drive in DRIVES.values()}
#: Radius of the grain where no scene gives it [m].
_RADIUS = 0.01
#: Standard deviations between the amplitude and its bounds.
_BOUNDS = 2.0
#: Delay of a channel's sample after its scan [s]: less than between two scans, at any rate that is used.
_LONGEST_DELAY = 1.0
#: Levels of rcl_interfaces/Log (info, warning, error) by Event.severity.
_LEVELS = (20, 30, 40)

Array = NDArray[np.float64]
Block: TypeAlias = "SampleBlock | PlantTruth"


class TraceError(InputError):
    """A message that has no place in time; one line."""


class Tracer:
    """What a run has come to: the ceiling's height, and whether the plant shows its true state."""

    def __init__(self, scene: Scene | None = None, rate: float = math.inf) -> None:
        """Trace at most `rate` samples a second; efficiency and the grain's radius need the `scene`."""
        self._scene, self._rate = scene, rate
        self._radius = scene.grain.radius if scene is not None else _RADIUS
        self._height = math.nan
        self._truth = self._forced = False

    def push(self, kind: str, content: object) -> Iterator[TraceRecord]:
        """Yield the records of one message of type atpid_interfaces/msg/`kind`; of other types none.

        The message is one that `message_checks` lets pass. Raises TraceError before the first record.
        """
        trace = getattr(self, f"_{kind}", None)
        if trace is not None and not getattr(content, "handshake", False):
            yield from trace(content)

    def _SampleBlock(self, block: SampleBlock) -> Iterator[TraceRecord]:  # noqa: N802 - named as the message
        unlikely = [delay for delay in block.skew if not 0.0 <= delay <= _LONGEST_DELAY]
        if unlikely:
            raise TraceError(f"a channel's delay is {unlikely[0]} s; allowed: 0 to {_LONGEST_DELAY:g} s")
        data = np.asarray(block.data, dtype=float).reshape(-1, len(block.channels))
        columns = {name: data[:, place] for place, name in enumerate(block.channels)}
        self._forced = self._forced or DRIVES["force"].channel in columns
        yield from self._samples(block, columns, block.skew)
        if not self._truth and "beam_displacement" in columns and _DRIVES & columns.keys():
            still = np.zeros(len(data))  # where a force drives the structure
            for place, time_ns in _places(block, PICTURES):
                support = float(columns.get("support_displacement", still)[place])
                beam = float(columns["beam_displacement"][place])
                yield damper(time_ns, Pose(support, beam, height=self._height), self._radius)

    def _PlantTruth(self, truth: PlantTruth) -> Iterator[TraceRecord]:  # noqa: N802
        self._truth = True
        columns = {name: np.asarray(getattr(truth, name)) for name in ("support", "beam", "grain", "ceiling")}
        yield from self._samples(truth, {f"true_{name}": values for name, values in columns.items()})
        for place, time_ns in _places(truth, PICTURES):
            support, *others = (float(values[place]) for values in columns.values())
            pose = Pose(0.0 if self._forced else support, *others)
            yield damper(time_ns, pose, self._radius)

    def _samples(self, block: Block, columns: Mapping[str, Array], skew: Sequence[float] = ()) -> Iterator[TraceRecord]:
        places = list(_places(block, self._rate))
        delays = skew if len(skew) else [0.0] * len(columns)
        for (name, values), delay in zip(columns.items(), delays, strict=True):
            later = round(1e9 * delay)
            for place, time_ns in places:
                yield number(name, time_ns + later, float(values[place]))

    def _Excitation(self, found: Excitation) -> Iterator[TraceRecord]:  # noqa: N802
        time_ns, bound = stamp_of(found), _BOUNDS * found.amplitude_std
        yield number("amplitude_low", time_ns, found.amplitude - bound)
        yield number("amplitude_high", time_ns, found.amplitude + bound)
        yield _text("excitation_quality", time_ns, Quality(found.quality).name.lower())
        if self._scene is not None and found.quality == Quality.STEADY and math.isfinite(found.beam_amplitude):
            closed = self._scene.linear_amplitude(found.amplitude, found.frequency, grain=True)
            if closed > 0.0:
                yield number("efficiency", time_ns, efficiency(found.beam_amplitude, closed))

    def _CeilingState(self, state: CeilingState) -> Iterator[TraceRecord]:  # noqa: N802
        self._height = state.height
        yield _text("ceiling_mode", stamp_of(state), Mode(state.mode).name.lower())

    def _SupervisorState(self, state: SupervisorState) -> Iterator[TraceRecord]:  # noqa: N802
        yield _text("supervisor_state", stamp_of(state), RunState(state.state).name.lower())

    def _Event(self, event: Event) -> Iterator[TraceRecord]:  # noqa: N802
        stamp = class_of("builtin_interfaces/msg/Time")(event.header.stamp.sec, event.header.stamp.nanosec)
        level, text = _LEVELS[event.severity], f"{event.kind}: {event.text}"
        line = class_of(LOG)(stamp=stamp, level=level, name=event.node, msg=text, file="", function="", line=0)
        yield message("log", stamp_of(event), LOG, line)


def _text(name: str, time_ns: int, word: str) -> TraceRecord:
    return message(name, time_ns, TEXT, class_of(TEXT)(word))


def _places(block: Block, rate: float) -> Iterator[tuple[int, int]]:
    """Yield place in the block and time [ns] of every n-th sample of the stream, at most `rate` a second."""
    every = max(1, math.ceil(block.rate / rate - 1e-9))
    start_ns = stamp_of(block)
    for place in range(-int(block.first_index) % every, scans_of(block), every):
        yield place, start_ns + round(1e9 * place / block.rate)


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
                writer = Writer(stream, compression=CompressionType.ZSTD)
                target = _Target(writer, bag, written)
                for record in _records(bag, Tracer(scene_of(bag), rate), written):
                    target.add(record)
                writer.finish()  # type: ignore[no-untyped-call]
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

    def _schema(self, record: TraceRecord) -> int:
        if record.type not in self._schemas:
            own = record.topic in self._bag.types
            text = self._bag.decoder.definition(record.type) if own else definition(record.type)
            self._schemas[record.type] = self._writer.register_schema(record.type, "ros2msg", text)
        return self._schemas[record.type]
