# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rules a recorded run has to keep, each fed message by message with bounded memory (docs/recording.md)."""

import math
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from atpid_common.injected_faults import CEILING, TO_THE_SWITCH, Injected
from atpid_sim.system import Array

#: Findings of one kind that are kept word for word; the others are counted.
KEPT = 20
#: Blocks an answer may be recorded before or after its block: one minute at 20 a second.
REACH = 1200
#: Rounding of a height: it is a whole number of micrometres on the wire [m].
_RESOLUTION = 2e-6
#: By how much the instant at which a real device has read its height may be wrong [s].
_JITTER = 0.02


class Findings:
    """What was found, by kind: the first of each word for word, all counted."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._texts: dict[str, list[str]] = {}

    def add(self, kind: str, text: str) -> None:
        """Take one finding."""
        self.counts[kind] += 1
        texts = self._texts.setdefault(kind, [])
        if len(texts) < KEPT:
            texts.append(text)

    def lines(self) -> list[str]:
        """Return a line for each finding kept, and one for those of a kind that were not."""
        lines = []
        for kind, texts in self._texts.items():
            lines += [f"{kind}: {text}" for text in texts]
            more = self.counts[kind] - len(texts)
            lines += [f"{kind}: and {more} more"] if more else []
        return lines


@dataclass
class RisingStamps:
    """The stamps of one topic, which have to rise."""

    topic: str
    strictly: bool
    newest: int = -1  # [ns]

    def add(self, stamp_ns: int, findings: Findings) -> None:
        """Take the next stamp."""
        if stamp_ns < self.newest or (self.strictly and stamp_ns == self.newest):
            findings.add("stamp", f"{self.topic}: {seconds(stamp_ns)} follows {seconds(self.newest)}")
        self.newest = max(self.newest, stamp_ns)


@dataclass
class NoGaps:
    """The sample indices of one stream, which have to be without a gap or a step back."""

    topic: str
    following: int | None = None
    scans: int = 0
    lost: int = 0
    dropped: int = 0  # by the device's own count

    def add(self, first: int, scans: int, dropped: int, findings: Findings) -> None:
        """Take a block's first index, its number of scans, and how many the device has lost since the start."""
        following = first if self.following is None else self.following
        if first > following:
            self.lost += first - following
            findings.add("lost", f"{self.topic}: {first - following} scans, index {following} to {first - 1}")
        elif first < following:
            findings.add("index", f"{self.topic}: the stream goes back to index {first} after {following - 1}")
        if (more := dropped - self.dropped) > 0:
            findings.add("lost", f"{self.topic}: {more} scans by the device's own count, before index {first}")
            self.dropped = dropped
        self.following = first + scans
        self.scans += scans


class AnswerMatching:
    """Blocks, estimates and commands by the instant they are about [ns]: each has to be there exactly once.

    In real time an answer may be recorded before what it answers, so an instant is judged when it is complete or when
    many later ones have come.
    """

    NAMES = ("block", "estimate", "command")

    def __init__(self) -> None:
        self.answered = 0
        #: A clock that fails on purpose gives several blocks one stamp: as many estimates and commands have to have it.
        self.shared_stamps = False
        self._open: dict[int, list[int]] = {}
        self._closed: deque[int] = deque(maxlen=REACH)
        self._recent: set[int] = set()

    def add(self, place: int, stamp_ns: int, findings: Findings) -> None:
        """Take a block (place 0, by its last scan), an estimate (1) or a command (2)."""
        if stamp_ns in self._recent:
            findings.add("twice", f"a second {self.NAMES[place]} for {seconds(stamp_ns)}")
            return
        counts = self._open.setdefault(stamp_ns, [0, 0, 0])
        counts[place] += 1
        if self.shared_stamps:
            return
        if counts[place] > 1:
            findings.add("twice", f"a second {self.NAMES[place]} for {seconds(stamp_ns)}")
        if all(counts):
            del self._open[stamp_ns]
            if len(self._closed) == REACH:
                self._recent.discard(self._closed[0])
            self._closed.append(stamp_ns)
            self._recent.add(stamp_ns)
            self.answered += 1
        elif len(self._open) > REACH:
            oldest = next(iter(self._open))
            self._judge(oldest, self._open.pop(oldest), findings)

    def end(self, findings: Findings, until_ns: int | None) -> None:
        """Judge what is still open. until_ns: last instant that has to be answered; None: a run that was stopped, whose
        last blocks may have been under way.
        """
        limit = max(self._recent, default=0) if until_ns is None else until_ns
        for stamp_ns, counts in sorted(self._open.items()):
            if self.shared_stamps and len(set(counts)) == 1:
                self.answered += counts[0]
            elif self.shared_stamps and all(counts):
                given = ", ".join(f"{count} {name}s" for name, count in zip(self.NAMES, counts, strict=True))
                findings.add("twice", f"{given} for {seconds(stamp_ns)}")
            elif self.shared_stamps or stamp_ns <= limit:
                self._judge(stamp_ns, counts, findings)
        self._open.clear()

    def _judge(self, stamp_ns: int, counts: list[int], findings: Findings) -> None:
        missing = [name for name, count in zip(self.NAMES, counts, strict=True) if not count]
        if counts[0]:
            findings.add("unanswered", f"the block that ends at {seconds(stamp_ns)} has no {' and no '.join(missing)}")
        else:
            given = " and ".join(name for name, count in zip(self.NAMES, counts, strict=True) if count)
            findings.add("unasked", f"{given} for {seconds(stamp_ns)}, where no block ends")


@dataclass
class AllowedCeiling:
    """What the ceiling is allowed. NaN: unknown, not checked."""

    lowest: float = math.nan  # [m]
    highest: float = math.nan  # [m]
    speed: float = math.nan  # [m/s]

    def narrow(self, lowest: float, highest: float, speed: float) -> None:
        """Take further limits; the narrower ones count."""
        self.lowest = float(np.fmax(self.lowest, lowest))
        self.highest = float(np.fmin(self.highest, highest))
        self.speed = float(np.fmin(self.speed, speed))

    def outside(self, heights: Iterable[float], beyond: float = 0.0) -> bool:
        """Whether one of the heights [m] is below the lowest, or more than `beyond` above the highest; NaN is not."""
        highest = self.highest + beyond + _RESOLUTION
        return any(height < self.lowest - _RESOLUTION or height > highest for height in heights)


class CeilingWithinLimits:
    """Heights and speeds, against their limits."""

    def __init__(self, limits: AllowedCeiling, lockstep: bool, injected: Sequence[Injected] = ()) -> None:
        """Take the limits, and the faults the run had on purpose, whose times are those of its clock."""
        self.limits = limits
        self._clock = any(fault.part == "clock" for fault in injected)
        self._sensor = [fault for fault in injected if fault.part == "height_sensor"]
        # a motor that cannot be switched off
        self._beyond = TO_THE_SWITCH if any(fault.part in CEILING for fault in injected) else 0.0
        #: In lockstep the stamp is the instant itself.
        self.jitter = 0.0 if lockstep else _JITTER
        self.low, self.high = math.inf, -math.inf  # of what was reported or simulated [m]
        self.begin = 0.0  # of the run, on its clock [s]
        self._state: tuple[int, float] | None = None
        self._end: tuple[int, float] | None = None  # last index and height of the truth

    def command(self, stamp_ns: int, height: float, findings: Findings) -> None:
        """Take a commanded height [m]; NaN: stay."""
        if math.isinf(height) or self.limits.outside([height]):
            findings.add("height", f"{height:g} m was commanded at {seconds(stamp_ns)}; {self._allowed()}")

    def state(self, stamp_ns: int, height: float, target: float, findings: Findings) -> None:
        """Take a reported height and target [m]; NaN: unknown."""
        late = 2.0 * _JITTER  # of a report after what it reports
        at = stamp_ns * 1e-9 - self.begin
        if self._clock or any(fault.begin <= at <= fault.end + late for fault in self._sensor):
            self._state = None  # none of the ceiling: its sensor failed on purpose, or the clock that stamps it
            return
        if self.limits.outside([target]) or self.limits.outside([height], self._beyond):
            where = f"the ceiling at {height:g} m for {target:g} m at {seconds(stamp_ns)}"
            findings.add("height", f"{where}; {self._allowed()}")
        if not math.isfinite(height):
            self._state = None
            return
        self._reached(height, height)
        before, self._state = self._state, (stamp_ns, height)
        if before is None or stamp_ns <= before[0]:
            return
        path, time = abs(height - before[1]), (stamp_ns - before[0]) * 1e-9
        if path > self.limits.speed * (time + self.jitter) + 2.0 * _RESOLUTION:
            went = f"the ceiling went {path:.6f} m in {time:.4f} s before {seconds(stamp_ns)}"
            findings.add("speed", f"{went}; allowed: {self.limits.speed:g} m/s")

    def truth(self, stamp_ns: int, first: int, rate: float, heights: Array, findings: Findings) -> None:
        """Take the simulated heights (n,) [m] from sample index `first` on at `rate` [Hz]."""
        low, high = float(heights.min()), float(heights.max())
        self._reached(low, high)
        if self.limits.outside([low, high], self._beyond):
            where = f"the simulated ceiling from {low:g} to {high:g} m in the block of {seconds(stamp_ns)}"
            findings.add("height", f"{where}; {self._allowed()}")
        before, self._end = self._end, (first + len(heights) - 1, float(heights[-1]))
        joined = heights if before is None or before[0] != first - 1 else np.concatenate(([before[1]], heights))
        fastest = float(np.abs(np.diff(joined)).max(initial=0.0)) * rate
        # the path of one sample, with the rounding of two heights
        if fastest > self.limits.speed * (1.0 + 1e-6) + 1e-9 * rate:
            moved = f"the simulated ceiling at {fastest:g} m/s in the block of {seconds(stamp_ns)}"
            findings.add("speed", f"{moved}; allowed: {self.limits.speed:g} m/s")

    def _reached(self, low: float, high: float) -> None:
        self.low, self.high = min(self.low, low), max(self.high, high)

    def _allowed(self) -> str:
        return f"allowed: {self.limits.lowest:g} to {self.limits.highest:g} m"


def seconds(stamp_ns: int) -> str:
    """Return a stamp in words, exact to the nanosecond."""
    return f"{stamp_ns // 1_000_000_000}.{stamp_ns % 1_000_000_000:09d} s"
