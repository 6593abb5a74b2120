# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a stream of blocks goes on and where another begins: the one rule of all readers for gaps and jumps.

A gap of at most a minute belongs to its segment, and readers fill it with NaN, as long as the gaps of a segment are not
many times what is there. Any other step of the index, ahead or back, begins another segment, as do another rate and
other channels: the work a bag takes grows with the samples in it, whatever their indices are.
"""

from dataclasses import dataclass
from typing import Any

from atpid_control.runs.losses import scans_of, stamp_of

#: Longest gap inside a segment [s]; all of its gaps together may be as long, and this many times its samples besides.
LONGEST_GAP, _SHARE = 60.0, 10
#: Segments of one topic that are told apart.
_MOST = 20
#: By how much the stamp of a block that continues an earlier segment may differ from its place there [ns].
_TOLERANCE = 1_000_000_000


@dataclass
class Segment:
    """Blocks whose indices go on."""

    number: int  # from 0 on, in its topic
    layout: tuple[Any, ...]  # rate [Hz], device, channels, units, delays
    first: int  # index of its first scan
    start_ns: int  # and its stamp
    offset: float  # of that scan after the begin of the bag, by stamp as far as that can be [s]
    following: int  # index of the scan after its last
    end_ns: int  # and its stamp, by the last block
    due: tuple[int, int] = (0, 0)  # what these two were before the last block
    jump: str = ""  # why it is another than that of the block before; empty: the first
    scans: int = 0
    lost: int = 0

    @property
    def rate(self) -> float:
        """Rate of its samples [Hz]."""
        return float(self.layout[0])

    def goes_on(self, layout: tuple[Any, ...], first: int, stamp_ns: int, last: bool) -> bool:
        """Whether a block that begins at index `first` continues it; `last`: it has the block before."""
        ahead = first - self.following
        if layout != self.layout or not 0 <= ahead <= LONGEST_GAP * self.rate:
            return False
        if ahead and self.lost + ahead > LONGEST_GAP * self.rate + _SHARE * self.scans:
            return False
        return last or abs(stamp_ns - self.end_ns - ahead / self.rate * 1e9) < _TOLERANCE


class Segments:
    """The segments of one topic, as its blocks come."""

    def __init__(self, start_ns: int = 0) -> None:
        """Begin; `start_ns` is the stamp of the bag's first sample."""
        self.all: list[Segment] = []
        self._start_ns = start_ns
        self._last: Segment | None = None  # that has the block before

    def place(self, block: Any) -> Segment | str:
        """Return the segment of a block that `message_checks` lets pass, or why it has none."""
        first, scans, stamp = int(block.first_index), scans_of(block), stamp_of(block)
        named = (tuple(getattr(block, name, ())) for name in ("channels", "units", "skew"))
        layout = (float(block.rate), getattr(block, "device", ""), *named)
        before = self._last
        known = [*([before] if before else []), *reversed(self.all)]
        segment = next((one for one in known if one.goes_on(layout, first, stamp, one is before)), None)
        if segment is None:
            # a counter that goes back while time goes on was started anew; the first blocks of it may be lost
            late = before is not None and stamp <= before.end_ns - 0.5e9 / before.rate
            if before is not None and late and layout == before.layout and 0 < first < before.following:
                return f"a block goes back to index {first} after {before.following - 1}"
            if len(self.all) == _MOST:
                return f"its index jumps for the {_MOST}th time"
            segment = Segment(len(self.all), layout, first, stamp, self._offset(stamp), first, stamp)
            if before is not None:
                segment.jump = f"its index goes from {before.following - 1} to {first}, at {segment.rate:g} Hz"
            self.all.append(segment)
        segment.due = segment.following, segment.end_ns
        segment.lost += first - segment.following
        segment.scans += scans
        segment.following = first + scans
        segment.end_ns = stamp + round(scans / segment.rate * 1e9)
        self._last = segment
        return segment

    def _offset(self, stamp_ns: int) -> float:
        """Return how long after the bag's first sample [s] a segment begins; a stamp far off counts as a limit."""
        if not self.all:
            return (stamp_ns - self._start_ns) * 1e-9
        first, longest = self.all[0], LONGEST_GAP + sum(one.scans / one.rate for one in self.all)
        return first.offset + min(max(0.0, (stamp_ns - first.start_ns) * 1e-9), longest)
