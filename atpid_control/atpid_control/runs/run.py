# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays on one time axis: signals, estimates, commands, ceiling, events, and what is missing.

`open_run` reads any bag in one pass: split, cut off, of another recorder, of hardware without the plant's truth; and a
table of numbers (.csv). Everything that analyses, draws or compares a recording begins here.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import Document, parse_yaml
from atpid_common.vocabulary import DRIVES, Drive, EventKind, Quality
from atpid_control.runs.commanded import as_put_out
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import table_reader
from atpid_control.runs.metadata import SCENE
from atpid_control.runs.read import kind_of, within_memory
from atpid_control.runs.signal import RecordedMotion, Signal, StreamClock, clock_of, joined
from atpid_control.runs.source import Source
from atpid_control.runs.tables import INDEX, STAMP, TIME, TRUTH, Columns, Piece, Table, Values
from atpid_sim.results import Shown
from atpid_sim.scene import Scene, SceneError, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.system import Array

if TYPE_CHECKING:  # they load slowly, and only tables of a run need them
    import pandas as pd
    import xarray as xr

    from atpid_sim.simulation.energy import Ledger

#: Channels of the laser; where a force drives the structure its load cell's is in place of the support's.
SUPPORT, BEAM = DRIVES["support"].channel, "beam_displacement"
#: The plant's own series, by the channels of sensors.
_TRUE = {BEAM: "beam"} | {drive.channel: "support" for drive in DRIVES.values()}
#: How far outside the run a stamp of it may be [s]: estimates come late, heights early.
_ASIDE = 60.0
#: Memory of one text in a column besides a number's [bytes].
_TEXT = 80


@dataclass(frozen=True, repr=False)
class Estimates(Shown):
    """The identified excitation, one value a block."""

    time: Array  # (k,) [s]
    steady: NDArray[np.bool_]  # (k,)
    amplitude: Array  # (k,) [m], of a force [N]
    amplitude_std: Array  # (k,) likewise
    frequency: Array  # (k,) [Hz]


@dataclass(frozen=True, repr=False)
class Heights(Shown):
    """Heights of the ceiling, commanded or reported."""

    time: Array  # (k,) [s]
    height: Array  # (k,) [m]; NaN: none, a command to stay


@dataclass(frozen=True)
class RunEvent:
    """One event."""

    time: float  # [s]
    severity: int  # 0 info, 1 warning, 2 alarm
    kind: str
    node: str
    text: str
    count: int = 1  # how many times in a row


@dataclass(frozen=True, repr=False)
class Run(Shown):
    """What a bag or a table holds."""

    path: Path
    start_ns: int  # stamp of the first sample, at time 0
    about: dict[str, str]  # run_id, commit, created, scene, clock, ...
    result: dict[str, str]  # finished, wall_s, real_time_factor, ...; empty: not closed
    files: dict[str, bytes]  # configuration, verbatim
    tables: dict[str, tuple[Table, Columns]]  # by name, each with its arrays by column
    unread: list[str]  # what cannot be read, a line each
    missing: list[str]  # that, and what was lost or left out
    scene: Scene | None = None
    scene_problem: str = ""  # why there is no scene, empty where there is one
    prefer: str = field(default=TRUTH, kw_only=True)  # origin of `motion` where there is one
    _clocks: dict[str, StreamClock] = field(default_factory=dict, kw_only=True, repr=False)

    def signal(self, name: str, origin: str = "") -> Signal:
        """Return a channel of the sensor that has most samples of it, or of one `origin`. Raises BagError."""
        return self.signals(name, origin=origin)[0]

    def signals(self, *names: str, origin: str = "") -> tuple[Signal, ...]:
        """Return channels at the same instants: of sensors, or of one `origin`. Raises BagError: there are none.

        Of several streams with all of them, or parts of one whose index jumps, that with most valid samples; where no
        stream has all, they are sampled anew at the instants of the slowest.
        """
        places = [_TRUE.get(name, name) if origin == TRUTH else name for name in names]
        streams = [(table, arrays) for table, arrays in self.streams(origin) if set(places) <= arrays.keys()]
        if not streams and len(names) > 1 and all(self._has(name, origin) for name in names):
            return joined([self.signal(name, origin) for name in names])
        if not streams:
            raise self._no_samples(names, origin)
        valid = [int(np.all([np.isfinite(arrays[place]) for place in places], axis=0).sum()) for _, arrays in streams]
        table, arrays = streams[int(np.argmax(valid))]
        if not len(arrays[INDEX]):
            span = f"{table.begin:g} to {table.begin + table.rows / (table.rate or 1.0):g} s"
            raise BagError(f"{self.path}: no sample from --from to --to; allowed: rising times from {span}")
        more = (other for other, its in streams if other is not table and len(its[INDEX]))
        others = tuple(f"{other.name}: {other.rows} samples, another stream, not used" for other in more)
        columns = {column.name: column for column in table.columns}
        clock = self._clock(table, arrays)
        begin, stamp = self._begin(table, arrays, clock), int(arrays[STAMP][0])
        of = table.origin, table.topic, table.lost, others
        made = zip(names, (columns[place] for place in places), strict=True)
        return tuple(
            Signal(name, begin, stamp, clock.rate, arrays[one.name], one.unit, *of, skew=one.skew, clock=clock)
            for name, one in made
        )

    def _clock(self, table: Table, arrays: Columns) -> StreamClock:
        if table.name not in self._clocks:
            made = table.origin == TRUTH or "/" not in table.type  # of a message, not of a table's format
            rate = table.rate or 1.0
            clock = StreamClock(rate) if made else clock_of(arrays[INDEX], arrays[STAMP], rate)
            self._clocks[table.name] = clock
        return self._clocks[table.name]

    def _begin(self, table: Table, arrays: Columns, clock: StreamClock) -> float:
        """Return when the first sample that was read was taken [s]."""
        if clock.course is not None:
            return float((int(arrays[STAMP][0]) - self.start_ns) * 1e-9 + clock.late)
        return table.begin + (int(arrays[INDEX][0]) - table.first_index) / clock.rate

    def _has(self, name: str, origin: str = "") -> bool:
        return any(name in arrays for _, arrays in self.streams(origin))

    @cached_property
    def drive(self) -> Drive:
        """What drives the structure: what was measured of both, else what the scene has, else its support."""
        channels = {column.name for table, _ in self.streams() for column in table.values}
        measured = [drive for drive in DRIVES.values() if drive.channel in channels]
        return measured[0] if measured else self.scene.driven_by if self.scene else DRIVES["support"]

    def driven(self, given: str = "", measured: str = BEAM) -> tuple[Signal, Signal]:
        """Return what excites and what answers, as sensors measured them; of what answers alone the other is NaN.

        given: empty: what drives the structure. Raises BagError: nothing answers.
        """
        given = given or self.drive.channel
        if self._has(given) and self._has(measured):
            first, second = self.signals(given, measured)
            return first, second
        answer = self.signal(measured)
        return replace(answer, name=given, values=np.full(len(answer.values), np.nan)), answer

    def streams(self, origin: str = "") -> list[tuple[Table, Columns]]:
        """Return the tables of samples, with their arrays: of sensors, or of one origin."""
        sampled = [(table, arrays) for table, arrays in self.tables.values() if table.rate is not None]
        return [one for one in sampled if (one[0].origin == origin if origin else one[0].origin != TRUTH)]

    def _no_samples(self, names: tuple[str, ...], origin: str) -> BagError:
        what = f"{' and '.join(names)}{' together' if len(names) > 1 else ''}{f' from {origin}' if origin else ''}"
        channels = sorted({column.name for table, _ in self.streams(origin) for column in table.values})
        why = f"; {self.missing[0]}" if self.missing else ""
        return BagError(f"{self.path}: no samples of {what}; channels in it: {', '.join(channels) or 'none'}{why}")

    @cached_property
    def measured(self) -> RecordedMotion:
        """Support and beam as a sensor measured them; of a beam alone the support is NaN. Raises BagError."""
        support, beam = self.driven()
        unknown = np.full(len(beam.values), np.nan)
        return RecordedMotion(beam.origin, beam.rate, beam.time, support.values, beam.values, unknown, unknown)

    @cached_property
    def truth(self) -> RecordedMotion | None:
        """The simulated plant's own motion; None of hardware."""
        if not self.streams(TRUTH):
            return None
        series = self.signals("support", "beam", "grain", "ceiling", origin=TRUTH)
        return RecordedMotion(TRUTH, series[0].rate, series[0].time, *(one.values for one in series))

    @cached_property
    def motion(self) -> RecordedMotion:
        """The motion to show: the plant's own where it is there and preferred, else the sensor's. Raises BagError."""
        measured = self.measured  # what has no sensor is no run of the stand
        return measured if self.truth is None or self.prefer != TRUTH else self.truth

    @property
    def duration(self) -> float:
        """Length of the motion, to the end of its last sample's interval [s]."""
        return float(self.motion.time[0]) + len(self.motion.time) / self.motion.rate

    @property
    def lost(self) -> int:
        """Samples of the beam's sensor that are missing, by index."""
        return self.signal(BEAM).lost

    @property
    def blocks(self) -> int:
        """Messages of the beam's sensor."""
        topic = self.signal(BEAM).topic
        return sum(table.rows for table, _ in self.tables.values() if table.topic == topic and table.rate is None)

    def messages(self, kind: str) -> Columns:
        """Return the fields (k,) of all messages of type atpid_interfaces/msg/`kind`, topic by topic.

        `time` [s], `stamp` [ns] and `received` [s] are among them; samples are not. Empty where there are none.
        """
        tables = [one for one in self.tables.values() if one[0].rate is None and kind_of(one[0].type) == kind]
        arrays = [arrays for _, arrays in sorted(tables, key=lambda one: one[0].topic)]
        names = set(arrays[0]).intersection(*arrays) if arrays else set()
        return {name: np.concatenate([one[name] for one in arrays]) for name in names}

    def _columns(self, kind: str, *names: str) -> list[Array]:
        """Return the messages' times and these numbers of theirs (k,), NaN: no number.

        Stamps far outside the run belong to none of its samples.
        """
        fields = self.messages(kind)
        columns = [np.array(fields.get(name, ()), dtype=np.float64) for name in (TIME, *names)]
        inside = self._of_the_run(columns[0])
        columns = [column[inside] for column in columns]
        return [np.where(np.isinf(column), np.nan, column) for column in columns]

    def _of_the_run(self, times: Array) -> NDArray[np.bool_]:
        return (times >= -_ASIDE) & (times <= self._end + _ASIDE)

    @cached_property
    def _end(self) -> float:
        try:
            return float(self.measured.time[-1])
        except BagError:  # nothing was measured
            return math.inf

    @cached_property
    def estimates(self) -> Estimates:
        """What was identified."""
        time, quality, *others = self._columns("Excitation", "quality", "amplitude", "amplitude_std", "frequency")
        return Estimates(time, quality == Quality.STEADY, *others)

    @cached_property
    def commands(self) -> Heights:
        """Where the ceiling was sent."""
        return Heights(*self._columns("CeilingCommand", "height"))

    @cached_property
    def ceiling(self) -> Heights:
        """Where the ceiling was, as its motor reported."""
        return Heights(*self._columns("CeilingState", "height"))

    @cached_property
    def all_events(self) -> list[RunEvent]:
        """Every event, whenever its stamp says it was."""
        fields = self.messages("Event")
        columns = (fields.get(name, np.zeros(0)) for name in (TIME, "severity", "kind", "node", "text"))
        return [RunEvent(float(time), int(severity), *texts) for time, severity, *texts in zip(*columns, strict=True)]

    @cached_property
    def events(self) -> list[RunEvent]:
        """The events of the run; consecutive equal ones are one."""
        events: list[RunEvent] = []
        inside = self._of_the_run(np.array([event.time for event in self.all_events]))
        for event in compress(self.all_events, inside):
            if events and (events[-1].kind, events[-1].text) == (event.kind, event.text):
                events[-1] = replace(events[-1], count=events[-1].count + 1)
            else:
                events.append(event)
        return events

    def faults(self, begin: float, end: float) -> list[str]:
        """Return a line for each fault that was reported from `begin` to `end` [s]."""
        return [
            f"fault at {event.time:.4g} s, {event.node}: {event.text}; choose a part without it with --from and --to"
            for event in self.all_events
            if event.kind == EventKind.FAULT and begin <= event.time <= end
        ]

    @cached_property
    def ledger(self) -> Ledger | None:
        """The plant's energy balance from its start to the end of the run; None of hardware."""
        from atpid_sim.simulation.energy import Ledger, relative_residual

        fields, motion = self.messages("PlantTruth"), self.truth
        if motion is None:
            return None
        names = ("input_energy", "beam_loss", "contact_loss", "ceiling_work", "stored_energy")
        work, beam, contact, ceiling, stored = (float(fields[name][-1]) for name in names)
        moves = self.drive is DRIVES["support"]
        stretch = max(abs(motion.beam[end] - moves * motion.support[end]) for end in (0, -1))
        sprung = 0.5 * self.scene.beam.stiffness * stretch**2 if self.scene is not None else 0.0
        residual = relative_residual(work, beam, contact, ceiling, stored, sprung)
        return Ledger(work, beam, contact, ceiling, stored, residual)

    @property
    def impacts(self) -> int:
        """How many contacts the simulated grain had with floor and ceiling."""
        return int(self.messages("PlantTruth").get("impacts", [0])[-1])

    @property
    def scene_text(self) -> str | None:
        """The scene the run was started with, word for word; None where none was recorded."""
        return self.files[SCENE].decode(errors="replace") if SCENE in self.files else None

    @cached_property
    def parameters(self) -> Document:
        """The parameters kept with the run, by the name of their file. Raises FileError: one is no YAML."""
        kept = {name: data for name, data in self.files.items() if name.endswith(".yaml") and name != SCENE}
        return {name.removesuffix(".yaml"): parse_yaml(data.decode(errors="replace")) for name, data in kept.items()}

    def tree(self) -> xr.DataTree:
        """Return the run as a tree of Datasets by topic: `tree["sensors/laser"]["support_displacement"]`."""
        from atpid_control.runs.tree import tree_of

        tree = tree_of(self.tables)
        files = {name: data.decode(errors="replace") for name, data in self.files.items() if name.endswith(".yaml")}
        own = {"bag": str(self.path), "start_ns": self.start_ns, "missing": self.missing, "files": files}
        tree.attrs.update(self.about | self.result | own)
        return tree

    to_xarray = tree

    def frames(self) -> dict[str, pd.DataFrame]:
        """Return the run as pandas tables by topic, `time` [s] as index; units and the rest are in `frame.attrs`."""
        from atpid_control.runs.tree import frames_of

        return frames_of(self.tree())


def open_run(path: Path | str, topics: Sequence[str] = (), begin: float = -math.inf, end: float = math.inf) -> Run:
    """Read a bag (its folder or one file), of one that breaks off what is there, or a .csv table of numbers.

    `topics`: those wanted, all where none is named. Of samples only those from `begin` to `end` [s] are kept, to the
    block, so that a part of a long bag takes the memory of the part. Raises BagError: neither, or nothing in it.
    """
    path = Path(path)
    if read_table := table_reader(path):
        table, arrays, missing = read_table(path)
        return Run(path, 0, {}, {}, {}, {table.name: (table, arrays)}, [], missing, None, "no scene was recorded")
    source = Source(path, topics)
    tables = _arrays(source, begin, end)
    if not tables:
        raise source.empty()
    scene, problem = _scene(source)
    about = source.run, source.result, source.files
    run = Run(path, source.start_ns, *about, tables, source.unread, source.missing, scene, problem)
    if scene is not None and scene.excitation.is_commanded:
        return replace(run, scene=as_put_out(scene, run.messages))
    return run


def _arrays(source: Source, begin: float, until: float) -> dict[str, tuple[Table, Columns]]:
    """Read the bag into arrays by table and column."""
    parts: defaultdict[str, list[tuple[Values, ...]]] = defaultdict(list)
    held = 0
    for piece in source.pieces():
        table = piece.table
        if table.rate is not None:  # by index: stamps may jump
            first, last = (table.begin + (piece.arrays[2][end] - table.first_index) / table.rate for end in (0, -1))
        if table.rate is None or (last >= begin and first <= until):
            parts[table.name].append(piece.arrays)
            held = within_memory(source.path, held + _size(piece))
    whole = {}
    for table in source.tables:
        if table.rows:
            names = [column.name for column in table.columns]
            pieces = parts.pop(table.name, None)  # so that the pieces of one table at a time are held twice
            empty = (np.zeros(0, column.dtype) for column in table.columns)
            arrays = map(np.concatenate, zip(*pieces, strict=True)) if pieces else empty
            whole[table.name] = table, dict(zip(names, arrays, strict=True))
    return whole


def _size(piece: Piece) -> int:
    return sum(array.nbytes + (_TEXT * len(array) if array.dtype == object else 0) for array in piece.arrays)


def _scene(source: Source) -> tuple[Scene | None, str]:
    """Return the scene in a bag, else why there is none."""
    try:
        text = source.scene_text
        if text is None:
            return None, "no scene was recorded"
        mapping = read_yaml(text, "recorded scene")
        return scene_from_mapping(mapping, source="recorded scene", folder=source.path), ""
    except (SceneError, BagError) as error:
        return None, str(error)
