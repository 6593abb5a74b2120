# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults that are injected on purpose: which part, what kind, from when to when; `faults` of a scene and of nodes.

As text, one fault is `PART KIND FROM TO [VALUE]` with times in seconds of the run: `support_laser stuck 4 6`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from atpid_common.errors import InputError

SENSORS = ("support_laser", "beam_laser", "accelerometer")
CEILING = ("height_sensor", "motor")
PARTS = (*SENSORS, *CEILING, "serial_link", "recorder", "clock")
#: What the graph in lockstep acts: its nodes are one process, and time is that of the samples.
LOCKSTEP = (*SENSORS, *CEILING, "clock")
#: What each part's place needs: the stand's real time, with the board's link or the recorder as a process.
LINK, RECORDER = ("serial_link",), ("recorder",)
KINDS = ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
#: How far beyond its highest height a ceiling may be driven that cannot be switched off: to the limit switch [m].
TO_THE_SWITCH = 0.010
#: The latest time of a fault [s].
_LATEST = 1e9


class FaultError(InputError):
    """An invalid fault, or one that cannot be injected where it is given."""


@dataclass(frozen=True)
class FaultKind:
    """What a kind does to a part: in words, its `value` where it has one, and what that is where none is given."""

    text: str
    unit: str = ""  # of the value; empty: it has none
    default: float = math.nan
    low: float = math.nan
    high: float = math.nan


def _sensor(unit: str, garbage: float) -> dict[str, FaultKind]:
    return {
        "off": FaultKind("no valid reading (NaN)"),
        "stuck": FaultKind("the last reading again and again"),
        "garbage": FaultKind("random readings between -value and value", unit, garbage, 1e-9, 1e6),
        "wrong": FaultKind("readings times value", "-", 0.7, 0.01, 100.0),
        "slow": FaultKind("a first-order lag with the time constant value", "s", 0.05, 1e-3, 100.0),
        "delayed": FaultKind("readings of the time value before", "s", 0.1, 1e-3, 10.0),
        "intermittent": FaultKind("no valid reading in the second half of each period value", "s", 0.1, 2e-3, 100.0),
    }


FAULT_KINDS: dict[str, dict[str, FaultKind]] = {
    "support_laser": _sensor("m", 0.15),
    "beam_laser": _sensor("m", 0.15),
    "accelerometer": _sensor("m/s^2", 500.0),
    "height_sensor": {
        "off": FaultKind("no reading: a broken wire"),
        "stuck": FaultKind("the last reading again and again"),
        "garbage": FaultKind("random readings over the ceiling's range"),
        "wrong": FaultKind("readings plus value", "m", 0.01, -1.0, 1.0),
        "slow": FaultKind("a first-order lag with the time constant value", "s", 0.5, 1e-3, 100.0),
        "delayed": FaultKind("readings of the time value before", "s", 0.2, 1e-3, 10.0),
        "intermittent": FaultKind("no reading in the second half of each period value", "s", 0.1, 2e-3, 100.0),
    },
    "motor": {
        "off": FaultKind("no motor power: it does not move"),
        "stuck": FaultKind("once it runs it cannot be switched off, as by a welded contact"),
        "garbage": FaultKind("it runs in a random direction, chosen every 0.1 s"),
        "wrong": FaultKind("it runs against its command: leads swapped"),
        "slow": FaultKind("its speed times value", "-", 0.25, 1e-3, 1.0),
        "delayed": FaultKind("it starts the time value after its command", "s", 0.2, 1e-3, 10.0),
        "intermittent": FaultKind("it stands in the second half of each period value", "s", 0.2, 2e-3, 100.0),
    },
    "serial_link": {
        "off": FaultKind("nothing passes: the cable is pulled"),
        "stuck": FaultKind("the last answer before the fault in place of each answer"),
        "garbage": FaultKind("random bytes in place of requests and answers"),
        "wrong": FaultKind("the height in answers plus value, their check sums right", "m", 0.01, -1.0, 1.0),
        "slow": FaultKind("value bytes a second pass", "byte/s", 300.0, 10.0, 1e6),
        "delayed": FaultKind("answers come the time value later", "s", 0.3, 1e-3, 10.0),
        "intermittent": FaultKind("nothing passes in the second half of each period value", "s", 0.6, 0.02, 100.0),
    },
    "recorder": {
        "off": FaultKind("it dies (SIGKILL)"),
        "stuck": FaultKind("what it writes hangs until the fault ends"),
        "garbage": FaultKind("one bit of each piece written is another one on the disk"),
        "wrong": FaultKind("the disk refuses what is written: it is full"),
        "slow": FaultKind("each piece written takes the time value longer", "s", 0.5, 1e-3, 10.0),
        "delayed": FaultKind("what is written is in the file the time value later", "s", 1.0, 1e-3, 10.0),
        "intermittent": FaultKind("writing hangs in the second half of each period value", "s", 2.0, 0.02, 100.0),
    },
    "clock": {
        "off": FaultKind("stamps are zero: no source of time"),
        "stuck": FaultKind("the last stamp again and again"),
        "garbage": FaultKind("stamps off by a random time up to value", "s", 1.0, 1e-3, 1e6),
        "wrong": FaultKind("stamps ahead by value: a clock that was set", "s", 3600.0, -1e8, 1e8),
        "slow": FaultKind("it loses the share value of the time: drift", "-", 0.05, 1e-6, 0.99),
        "delayed": FaultKind("stamps behind by value", "s", 0.5, 1e-3, 1e6),
        "intermittent": FaultKind("behind by 0.5 s in the second half of each period value", "s", 0.4, 0.01, 100.0),
    },
}


@dataclass(frozen=True)
class Injected:
    """One fault: part, kind, from `begin` to `end` [s of the run], and its value (`FAULT_KINDS`)."""

    part: str
    kind: str
    begin: float
    end: float
    value: float = math.nan

    def __post_init__(self) -> None:
        """Raise FaultError where part, kind, times or value cannot be; a NaN value becomes the kind's default."""
        if reason := problem(self.part, self.kind, self.begin, self.end, self.value):
            raise FaultError(reason)
        if math.isnan(self.value):
            object.__setattr__(self, "value", FAULT_KINDS[self.part][self.kind].default)

    def active(self, time: float) -> bool:
        """Whether the fault is there at `time` [s]."""
        return self.begin <= time < self.end

    def gap(self, time: float) -> bool:
        """Whether `time` [s] is in the second half of a period of an intermittent fault."""
        return self.kind == "intermittent" and (time - self.begin) % self.value >= 0.5 * self.value

    def __str__(self) -> str:
        value = "" if math.isnan(self.value) else f" {self.value!r}"
        return f"{self.part} {self.kind} {self.begin!r} {self.end!r}{value}"


def active_fault(faults: Sequence[Injected], time: float, part: str = "") -> Injected | None:
    """Return the first fault that is there at `time` [s], of one part where it is named; None: none is."""
    return next((fault for fault in faults if part in ("", fault.part) and fault.active(time)), None)


def problem(part: str, kind: str, begin: float, end: float, value: float) -> str:
    """Return in one line why such a fault cannot be; empty: it can."""
    if part not in PARTS:
        return f"part: given {part!r}; allowed: {', '.join(PARTS)}"
    if kind not in KINDS:
        return f"kind: given {kind!r}; allowed: {', '.join(KINDS)}"
    if not (0.0 <= begin < end <= _LATEST):
        return f"{part} {kind}: given from {begin:g} to {end:g} s; allowed: rising times from 0 to {_LATEST:g} s"
    meaning = FAULT_KINDS[part][kind]
    if math.isnan(value):
        return ""
    if not meaning.unit:
        return f"{part} {kind}: given the value {value:g}; allowed: none, this kind has no value"
    if not meaning.low <= value <= meaning.high:
        return f"{part} {kind}: given the value {value:g} {meaning.unit}; allowed: {meaning.low:g} to {meaning.high:g}"
    return ""


def overlapping(faults: Sequence[Injected]) -> tuple[Injected, Injected] | None:
    """Return two faults of one part that are there at the same time; None: none are."""
    for part in {fault.part for fault in faults}:
        ordered = sorted((fault for fault in faults if fault.part == part), key=lambda fault: fault.begin)
        for first, second in pairwise(ordered):
            if second.begin < first.end:
                return first, second
    return None


def parsed(lines: Sequence[str], parts: Sequence[str], where: str) -> tuple[Injected, ...]:
    """Return the faults in `lines` (`PART KIND FROM TO [VALUE]`), empty lines left out.

    Raises FaultError for an invalid fault, and for a part that is not one of `parts`, which `where` injects.
    """
    found = tuple(_of_line(line) for line in lines if line)
    for fault in found:
        if fault.part not in parts:
            raise FaultError(f"faults: given {fault.part}; allowed: {', '.join(parts)}, which {where} injects")
    return found


def _of_line(line: str) -> Injected:
    words = line.split()
    allowed = "allowed: PART KIND FROM TO [VALUE] with times in s, such as 'support_laser stuck 4 6'"
    if len(words) not in (4, 5):
        raise FaultError(f"faults: given {line!r}; {allowed}")
    try:
        numbers = [float(word) for word in words[2:]]
    except ValueError:
        raise FaultError(f"faults: given {line!r}; {allowed}") from None
    return Injected(words[0], words[1], *numbers)
