# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a bag gives to be played: its messages, by the definitions installed, or its support's motion for a scene.

And how far a replay's answers agree with the bag's.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from atpid_common.vocabulary import DRIVES
from atpid_control.runs.decode import Converter, message_type
from atpid_control.runs.errors import BagError, in_words
from atpid_control.runs.read import Bag, kind_of, open_bag
from atpid_control.runs.run import Run
from atpid_control.runs.tables import STAMP
from atpid_control.runs.topics import BLOCK, block_shape
from atpid_control.runs.topics import stamp as stamp_in
from atpid_sim.system import Array

#: The channels of the identifier: each block that has one is answered once.
_ANSWERED = {drive.channel for drive in DRIVES.values()}


@dataclass(frozen=True)
class Item:
    """One message to play."""

    topic: str
    time_ns: int  # log time [ns]
    data: bytes
    answer_ns: int | None  # stamp of the answer that follows: the block's last sample [ns]; None: no answer


@dataclass(frozen=True)
class Playback:
    """The messages to play in the order of their log times."""

    bag: Bag
    items: tuple[Item, ...]
    channels: dict[str, tuple[list[str], list[str]]]  # channels and units of each block topic
    notes: tuple[str, ...] = ()  # what was converted, a line for each message type

    @property
    def topics(self) -> dict[str, str]:
        """Message type of each topic played."""
        return {item.topic: self.bag.types[item.topic] for item in self.items}

    @property
    def start_ns(self) -> int:
        """Log time of the first message [ns]."""
        return self.items[0].time_ns

    @property
    def seconds(self) -> float:
        """From the first message to the last [s]."""
        return (self.items[-1].time_ns - self.start_ns) * 1e-9

    @property
    def last_stamp_ns(self) -> int:
        """Stamp of the last sample that is answered [ns]."""
        return max(item.answer_ns for item in self.items if item.answer_ns is not None)


def load_playback(path: Path, patterns: list[str]) -> Playback:
    """Read a bag and choose topics by `patterns` ("sensors/*", in any namespace).

    Messages recorded with an older definition are converted to the one installed. Raises BagError: no bag, nothing to
    play, no block the identifier would answer, or messages that cannot be converted.
    """
    bag = open_bag(path)
    anywhere = [f"*/{pattern.lstrip('/')}" for pattern in patterns]
    chosen = [topic for topic in bag.types if any(fnmatchcase(topic, pattern) for pattern in anywhere)]
    if not chosen:
        has = ", ".join(sorted(bag.types)) or "no messages"
        raise BagError(f"{path}: no topic fits {', '.join(patterns) or 'an empty list'}; the bag has {has}")
    converters = {kind: _converter(bag, kind) for kind in dict.fromkeys(bag.types[topic] for topic in chosen)}
    first_blocks = {topic: next(bag.messages(topic), None) for topic in chosen if bag.types[topic] == BLOCK}
    channels = {topic: (list(b[1].channels), list(b[1].units)) for topic, b in first_blocks.items() if b is not None}
    answered = {topic for topic, (names, _) in channels.items() if _ANSWERED & set(names)}
    items = []
    for raw in bag.raw:
        if raw.topic in chosen:
            converter = converters[bag.types[raw.topic]]
            data = converter.convert(bag.decode(raw)) if converter else raw.data
            items.append(Item(raw.topic, raw.log_ns, data, _last_sample(data) if raw.topic in answered else None))
    if not any(item.answer_ns is not None for item in items):
        raise BagError(
            f"{path}: no sensors topic with the channel {' or '.join(sorted(_ANSWERED, reverse=True))}, so there is "
            "nothing to identify in this bag"
        )
    notes = (_conversion(bag, kind, converter) for kind, converter in converters.items() if converter)
    return Playback(bag, tuple(items), channels, tuple(notes))


def _converter(bag: Bag, kind: str) -> Converter | None:
    """Return what converts messages of the type `kind`; None where they are played as they are."""
    recorded = {bag.hashes[topic] for topic, name in bag.types.items() if name == kind}
    if recorded == {message_type(kind).hash}:
        return None
    try:
        converter = Converter(kind, bag.decoder)
    except BagError as error:
        commit = bag.run.get("commit", "unknown")
        raise BagError(f"{bag.path}: {error}; replay it with the version that recorded it ({commit})") from None
    return None if converter.identical else converter


def _conversion(bag: Bag, kind: str, converter: Converter) -> str:
    differences = [f"{field} was recorded as header.frame_id" for field in converter.moved]
    differences += [f"{field} is not in the bag and keeps its default" for field in converter.missing]
    differences += [f"{field} is left out" for field in converter.dropped]
    listed = "; ".join(differences) or "the fields stand in another order"
    version = f"version {bag.run.get('commit', 'unknown')}"
    return f"{kind} was recorded with another definition ({version}) and is converted: {listed}"


def _last_sample(data: bytes) -> int | None:
    shape = block_shape(data)
    return stamp_in(data) + round((shape.scans - 1) / shape.rate * 1e9) if shape.scans else None


#: What is compared of each message type: what the controller and the ceiling act on, not the wording of a reason.
_COMPARED = {
    "Excitation": ("quality", "amplitude", "frequency"),
    "CeilingCommand": ("sequence", "height", "excitation_amplitude", "method"),
}
#: What another processor rounds otherwise: a number's last digit over the least pivot of a fit, `linear.LEAST_PIVOT`.
RELATIVE, ABSOLUTE = 2.0**-52 / 1e-11, 1e-9


@dataclass(frozen=True)
class ReplayAgreement:
    """How many messages of a topic the replay repeats."""

    topic: str
    recorded: int
    agreeing: int
    first_difference: str  # in words; empty: all agree

    def __str__(self) -> str:
        line = f"{self.topic}: {self.agreeing} of {self.recorded} agree"
        return f"{line}; first difference: {self.first_difference}" if self.first_difference else line


def compare(recorded: Run, replayed: Run) -> list[ReplayAgreement]:
    """Return the agreement of every topic with estimates or commands; messages belong together by their stamps."""
    agreements = []
    for kind, names in _COMPARED.items():
        answers = {stamp: row for _, rows in _rows(replayed, kind, names) for stamp, row in rows}
        for topic, rows in _rows(recorded, kind, names):
            start = min((stamp for stamp, _ in rows), default=0)
            differing = []
            for stamp, row in rows:
                if text := _difference(row, answers.get(stamp), names):
                    differing.append(f"{(stamp - start) * 1e-9:.3f} s after the first, {text}")
            agreeing = len(rows) - len(differing)
            agreements.append(ReplayAgreement(topic, len(rows), agreeing, differing[0] if differing else ""))
    return agreements


def _rows(run: Run, kind: str, names: tuple[str, ...]) -> Iterator[tuple[str, list[tuple[int, tuple[object, ...]]]]]:
    """Yield each topic with messages of a type, and their (stamp [ns], values of the fields)."""
    for table, arrays in sorted(run.tables.values(), key=lambda one: one[0].topic):
        if kind_of(table.type) == kind:
            values = zip(*(arrays[name].tolist() for name in names), strict=True)
            yield table.topic, list(zip(arrays[STAMP].tolist(), values, strict=True))


def _difference(recorded: tuple[object, ...], replayed: tuple[object, ...] | None, names: tuple[str, ...]) -> str:
    """Return in words how an answer differs; empty: it does not."""
    if replayed is None:
        return "no answer"
    pairs = zip(names, recorded, replayed, strict=True)
    return ", ".join(f"{name} {one!r} is now {other!r}" for name, one, other in pairs if not _equal(one, other))


def _equal(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        both_unknown = math.isnan(one) and math.isnan(other)
        return both_unknown or math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return bool(one == other)


_SUPPORT_FILE = "support.csv"


def support_series(run: Run, begin: float = 0.0, end: float = math.inf) -> tuple[Array, Array]:
    """Return times (n,) of the run [s] and support's displacements [m] or forces [N] (n,), from `begin` to `end` [s].

    Times are index / rate: stamps jitter, indices prove that nothing is missing. `run` is read from `begin` to `end`.
    Raises BagError: no such channel, or scans that are lost, invalid or of two streams in between.
    """
    signal = run.signal(run.drive.channel)
    time = signal.time
    inside = (time >= begin) & (time <= end)
    if not inside.any():
        span = f"allowed: times from {time[0]:g} to {time[-1]:g} s"
        raise BagError(f"{run.path}: no scan from {begin:g} to {end:g} s; {span}")
    advice = "take a part without it, --support FROM:TO with TO below or FROM above"
    invalid = time[inside & ~np.isfinite(signal.values)]
    if len(invalid):
        raise BagError(f"{run.path}: {signal.name} is lost or invalid at {invalid[0]:g} s; {advice} {invalid[0]:g}")
    if signal.others:
        raise BagError(f"{run.path}: {signal.topic} starts anew: {signal.others[0]}; {advice} {time[-1]:g}")
    return time[inside], signal.values[inside]


def write_support(run: Run, folder: Path, begin: float = 0.0, end: float = math.inf) -> str:
    """Write the series as `folder`/support.csv and return a line about it. Raises BagError."""
    path = folder / _SUPPORT_FILE
    if path.exists():
        raise BagError(f"{path}: exists already and is not written over; give another folder with --out")
    times, values = support_series(run, begin, end)
    drive = run.drive
    lines = [f"time,{drive.channel}", *(f"{t!r},{u!r}" for t, u in zip(times.tolist(), values.tolist(), strict=True))]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise BagError(f"{path}: cannot be written: {in_words(error)}") from None
    lasts = times[-1] - times[0]
    span = f"{len(times)} samples over {lasts:g} s, from {values.min():g} to {values.max():g} {drive.unit}"
    return f"{path}: {span}, of {run.signal(drive.channel).origin}"
