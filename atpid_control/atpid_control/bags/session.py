# SPDX-License-Identifier: Apache-2.0
"""One recording from its first message to its last: what is counted, what is written and when it is complete."""

import heapq
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

from atpid_common.scans import misplaced
from atpid_control.bags import cdr
from atpid_control.bags.errors import BagError, MessageError
from atpid_control.bags.metadata import Qos, RunInfo
from atpid_control.bags.topics import BLOCK, EVENT, TRUTH, Topic
from atpid_control.bags.writer import CHUNK, BagWriter, Sink

#: How far behind the slowest topic of the loop messages are written [ns]: ten blocks, for events that come late.
HOLD_BACK_NS = 500_000_000


class Held(NamedTuple):
    """A message that waits for its place; compares by stamp, topic, sender and arrival."""

    stamp_ns: int
    rank: int  # of the topic in the recorder's list
    frame_id: str
    arrival: int
    topic: str
    data: bytes


class StampOrder:
    """Sorts messages by (stamp, order of topics, sender, arrival), whatever order they arrived in.

    Two runs in lockstep with one seed then give the same sequence, although DDS delivers topics side by side. A message
    is ready when every topic of the loop has passed its stamp by the hold-back.
    """

    def __init__(self, topics: list[str], loop: set[str], hold_back_ns: int = HOLD_BACK_NS) -> None:
        """Sort messages of `topics`; those in `loop` carry every stamp of the run and so show its progress."""
        self._ranks = {topic: rank for rank, topic in enumerate(topics)}
        self._loop, self._hold_back = loop, hold_back_ns
        self._newest: dict[str, int] = {}
        self._held: list[Held] = []
        self._arrivals = count()

    def __len__(self) -> int:
        return len(self._held)

    def add(self, topic: str, stamp_ns: int, frame_id: str, data: bytes) -> None:
        """Take one message."""
        heapq.heappush(self._held, Held(stamp_ns, self._ranks[topic], frame_id, next(self._arrivals), topic, data))
        if topic in self._loop:
            self._newest[topic] = max(stamp_ns, self._newest.get(topic, stamp_ns))

    def ready(self) -> Iterator[Held]:
        """Yield, in order, the messages that no later one can precede."""
        if not self._newest:
            return
        limit = min(self._newest.values()) - self._hold_back
        while self._held and self._held[0].stamp_ns < limit:
            yield heapq.heappop(self._held)

    def rest(self) -> Iterator[Held]:
        """Yield all that is left, in order: the run is over."""
        while self._held:
            yield heapq.heappop(self._held)


Offered = Callable[[str], tuple[Qos, ...]]

#: Kinds of Event at the begin and the end of a run.
_STARTED, _FINISHED = "started", "finished"
#: Stamps of one instant may differ by rounding [ns].
_SAME_INSTANT = 10_000
#: After the run's end, how long a topic may stay silent before the bag is closed without it [s].
TIMEOUT = 2.0


@dataclass
class Continuity:
    """The scans of one stream; each block has to begin at the sample index where the one before ended."""

    next_index: int | None = None
    scans: int = 0  # received
    lost: int = 0  # missing between blocks
    gaps: int = 0  # times that scans were missing
    dropped: int = 0  # lost by the device's own count

    def add(self, block: cdr.BlockShape) -> int:
        """Take the next block; return how many scans are missing before it (0: none)."""
        missing = 0 if self.next_index is None else max(0, block.first_index - self.next_index)
        self.next_index = block.first_index + block.scans
        self.scans += block.scans
        self.lost += missing
        self.gaps += missing > 0
        self.dropped = block.dropped
        return missing


class Session:
    """Takes serialised messages as they arrive and keeps the bag; pure, so that it can be tested without ROS."""

    def __init__(
        self, folder: Path, run: RunInfo, topics: list[Topic], *, lockstep: bool, offered: Offered,
        chunk: int = CHUNK, compression: str = "zstd", sink: Callable[[Path], Sink] = Sink,
    ) -> None:  # fmt: skip
        """Open the bag at once; `offered` returns the quality of service of a topic's publishers. Raises BagError."""
        self.topics = {topic.name: topic for topic in topics}
        self.received = dict.fromkeys(self.topics, 0)
        self.written = dict.fromkeys(self.topics, 0)
        self.continuity = {topic.name: Continuity() for topic in topics if topic.type == BLOCK}
        self._lockstep, self._offered = lockstep, offered
        self.order = StampOrder(list(self.topics), {topic.name for topic in topics if topic.in_loop})
        self._reached: dict[str, int] = {}  # per loop topic: instant its data are complete to [ns]
        self._sources: set[str] = set()  # nodes that have published the event `started`
        self._first_ns = 0
        self._finished_ns: int | None = None
        self._began = self._sampled = self._ended = self._progress = 0.0  # monotonic [s]
        self.writer = BagWriter(folder, run, chunk=chunk, compression=compression, sink=sink)
        self.recording = True

    @property
    def elapsed(self) -> float:
        """Time since the first block of samples [s]; NaN before."""
        return time.monotonic() - self._sampled if self._sampled else math.nan

    @property
    def newest_ns(self) -> int | None:
        """How far the run's data have come [ns]; None before the first."""
        return max(self._reached.values(), default=None)

    def receive(self, topic: str, data: bytes, now_ns: int) -> int:
        """Take one message received at `now_ns`; return how many scans are missing before it.

        Raises MessageError for a message that has no place in a record, which is left out, and BagError.
        """
        self.received[topic] += 1
        if not self.recording:
            return 0
        kind = self.topics[topic]
        if not kind.has_header:
            self._write(topic, data, now_ns, now_ns)
            return 0
        head = cdr.header(data)
        if head.stamp_ns < 0:
            raise MessageError("its stamp is before 1970")
        if kind.has_handshake and cdr.is_handshake(data):
            return 0
        missing = self._follow(kind, head, data)
        if not self._lockstep:
            self._write(topic, data, now_ns, head.stamp_ns)
        else:
            self.order.add(topic, head.stamp_ns, head.frame_id, data)
            for held in self.order.ready():
                self._write(held.topic, held.data, held.stamp_ns, held.stamp_ns)
        return missing

    def _follow(self, topic: Topic, head: cdr.Header, data: bytes) -> int:
        """Follow the progress of the run; return how many scans are missing.

        A run's end counts only from a source, where one has announced its begin.
        """
        missing, reached, now = 0, head.stamp_ns, time.monotonic()
        if topic.type == BLOCK:
            shape = _checked(cdr.block_shape(data))
            self._sampled = self._sampled or now
            missing = self.continuity[topic.name].add(shape)
            reached = _end_of(shape, head.stamp_ns)
        elif topic.type == TRUTH:
            reached = _end_of(_checked(cdr.truth_shape(data)), head.stamp_ns)
        elif topic.type == EVENT:
            kind = cdr.event_kind(data)
            if kind == _STARTED:
                self._sources.add(head.frame_id)
            elif kind == _FINISHED and (not self._sources or head.frame_id in self._sources):
                self._finished_ns, self._ended, self._progress = head.stamp_ns, now, now
        if topic.in_loop:
            if not self._began:
                self._began, self._first_ns = now, head.stamp_ns
            self._progress = now if topic.name in self.missing_topics() else self._progress
            self._reached[topic.name] = max(reached, self._reached.get(topic.name, reached))
        return missing

    def missing_topics(self) -> list[str]:
        """Return the topics that have not reached the end of a finished run; none before."""
        if self._finished_ns is None:
            return []
        return [name for name, reached in self._reached.items() if reached < self._finished_ns - _SAME_INSTANT]

    @property
    def complete(self) -> bool:
        """Whether the run has finished and every topic that took part has reached its end, or is silent."""
        if self._finished_ns is None or not self.recording:
            return False
        return not self.missing_topics() or time.monotonic() - self._progress > TIMEOUT

    def result(self) -> dict[str, str]:
        """Return the results, as the bag stores them: durations [s], real-time factor, scans lost."""
        if not self._began:
            return {"finished": "no"}
        ended = self._ended or time.monotonic()
        last = max((*self._reached.values(), self._finished_ns or self._first_ns))
        wall, seconds = max(ended - self._began, 1e-9), (last - self._first_ns) * 1e-9
        lost = {f"lost_scans {name}": str(flow.lost) for name, flow in self.continuity.items() if flow.scans}
        return {
            "finished": "no" if self._finished_ns is None else "yes",
            "wall_s": f"{wall:.3f}",
            "data_s": f"{seconds:.3f}",
            "real_time_factor": f"{seconds / wall:.3f}",
            **lost,
        }

    def end_chunk(self) -> None:
        """Make sure that a crash from now on loses only what comes later. Raises BagError."""
        if self.recording:
            self._guarded(self.writer.end_chunk)

    def sync(self) -> None:
        """Make sure that a power cut from now on loses only what comes later. Raises BagError."""
        if self.recording:
            self._guarded(self.writer.sync)

    def keep(self, name: str, data: bytes) -> None:
        """Keep a file in the bag, verbatim. Raises BagError."""
        if self.recording:
            self._guarded(lambda: self.writer.attach(name, data))

    def close(self) -> None:
        """Write what still waits, the result and the index; twice does nothing. Raises BagError."""
        if not self.recording:
            return
        for held in self.order.rest():
            self._write(held.topic, held.data, held.stamp_ns, held.stamp_ns)
        self.recording = False
        self.writer.close(self.result())

    def _write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        if topic not in self.writer.channels:
            self._guarded(lambda: self.writer.add_topic(topic, self.topics[topic].type, self._offered(topic)))
        self._guarded(lambda: self.writer.write(topic, data, log_ns, publish_ns))
        self.written[topic] += 1

    def _guarded(self, act: Callable[[], None]) -> None:
        """Call `act`; an error of the disk ends the recording."""
        try:
            act()
        except BagError:
            self.recording = False
            raise


def _checked(shape: cdr.BlockShape) -> cdr.BlockShape:
    """Return `shape`; raise MessageError where its scans have no place in time."""
    if reason := misplaced(shape.first_index + shape.scans, shape.rate):
        raise MessageError(reason)
    return shape


def _end_of(shape: cdr.BlockShape, stamp_ns: int) -> int:
    """Return the instant after the last scan of a block [ns]."""
    return stamp_ns + round(shape.scans / shape.rate * 1e9)
