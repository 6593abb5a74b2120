# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One recording from its first message to its last: what is counted, what is written, in which order."""

import heapq
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

from atpid_common.message_checks import time_out_of_range
from atpid_common.vocabulary import EventKind
from atpid_control.recording.trigger import PreTrigger, Trigger
from atpid_control.runs.decode import is_handshake, message_type
from atpid_control.runs.errors import MessageError
from atpid_control.runs.metadata import Qos, RunInfo
from atpid_control.runs.topics import BLOCK, EVENT, BlockShape, Topic, block_shape, event, shape_of, stamp
from atpid_control.runs.writer import CHUNK, BagWriter, Sink, Split

#: How far behind the slowest topic of the loop messages are written [ns]: ten blocks, for events that come late.
_HOLD_BACK_NS = 500_000_000


class _UnorderedMessage(NamedTuple):
    """A message that waits for its place; compares by stamp, topic, sender and arrival."""

    stamp_ns: int
    rank: int  # of the topic in the recorder's list
    node: str  # of an event; empty: a topic of one node
    arrival: int
    topic: str
    data: bytes


class StampOrder:
    """Sorts messages by (stamp, order of topics, sender, arrival), whatever order they arrived in.

    Two runs in lockstep with one seed then give the same sequence, although DDS delivers topics side by side. A message
    is ready when every topic of the loop has passed its stamp by the hold-back.
    """

    def __init__(self, topics: list[str], loop: set[str], hold_back_ns: int = _HOLD_BACK_NS) -> None:
        """Sort messages of `topics`; those in `loop` carry every stamp of the run and so show its progress."""
        self._ranks = {topic: rank for rank, topic in enumerate(topics)}
        self._loop, self._hold_back = loop, hold_back_ns
        self._newest: dict[str, int] = {}
        self._held: list[_UnorderedMessage] = []
        self._arrivals = count()

    def __len__(self) -> int:
        return len(self._held)

    def add(self, topic: str, stamp_ns: int, node: str, data: bytes) -> None:
        """Take one message."""
        message = _UnorderedMessage(stamp_ns, self._ranks[topic], node, next(self._arrivals), topic, data)
        heapq.heappush(self._held, message)
        if topic in self._loop:
            self._newest[topic] = max(stamp_ns, self._newest.get(topic, stamp_ns))

    def ready(self) -> Iterator[_UnorderedMessage]:
        """Yield, in order, the messages that no later one can precede."""
        if not self._newest:
            return
        limit = min(self._newest.values()) - self._hold_back
        while self._held and self._held[0].stamp_ns < limit:
            yield heapq.heappop(self._held)

    def rest(self) -> Iterator[_UnorderedMessage]:
        """Yield all that is left, in order: the run is over."""
        while self._held:
            yield heapq.heappop(self._held)


_Offered = Callable[[str], tuple[Qos, ...]]

#: Stamps of one instant may differ by rounding [ns].
_SAME_INSTANT = 10_000
#: After the run's end, how long a topic may stay silent before the bag is closed without it [s].
_TIMEOUT = 2.0


@dataclass
class _Continuity:
    """The scans of one stream; each block has to begin at the sample index where the one before ended."""

    next_index: int | None = None
    scans: int = 0  # received
    lost: int = 0  # missing between blocks

    def add(self, block: BlockShape) -> int:
        """Take the next block; return how many scans are missing before it (0: none)."""
        missing = 0 if self.next_index is None else max(0, block.first_index - self.next_index)
        self.next_index = block.first_index + block.scans
        self.scans += block.scans
        self.lost += missing
        return missing


@dataclass(frozen=True)
class Writing:
    """How the file is written: its chunks, when another file begins, and what has to happen first."""

    chunk: int = CHUNK  # [bytes]
    compression: str = "zstd"
    split: Split | None = None  # None: one file
    trigger: Trigger | None = None  # None: record at once


class RecordingSession:
    """Takes serialised messages as they arrive and keeps the bag; pure, so that it can be tested without ROS."""

    def __init__(
        self,
        folder: Path,
        run: RunInfo,
        topics: list[Topic],
        *,
        lockstep: bool,
        offered: _Offered,
        writing: Writing | None = None,
        sink: Callable[[Path], Sink] = Sink,
    ) -> None:
        """Open the bag at once; `offered` returns the quality of service of a topic's publishers. Raises BagError."""
        writing = writing or Writing()
        self.topics = {topic.name: topic for topic in topics}
        self.received = dict.fromkeys(self.topics, 0)
        self.written = dict.fromkeys(self.topics, 0)
        self.continuity = {topic.name: _Continuity() for topic in topics if topic.type == BLOCK}
        self._lockstep, self._offered = lockstep, offered
        self.order = StampOrder(list(self.topics), {topic.name for topic in topics if topic.in_loop})
        self._reached: dict[str, int] = {}  # per loop topic: instant its data are complete to [ns]
        self._sources: set[str] = set()  # nodes that have published the event `started`
        self._first_ns = 0
        self._finished = False
        self._end_ns: int | None = None  # of the run, or of what a trigger records
        self.waiting = PreTrigger(writing.trigger, topics) if writing.trigger else None
        self._recorded = {name: _Continuity() for name in self.continuity}  # scans written, after a trigger
        self._began = self._sampled = self._ended = self._progress = 0.0  # monotonic [s]
        form, split = writing.compression, writing.split
        self.writer = BagWriter(folder, run, chunk=writing.chunk, compression=form, sink=sink, split=split)

    @property
    def recording(self) -> bool:
        """Whether the bag is open: it was not closed, and the disk takes what is written."""
        return not self.writer.closed

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
        known = message_type(kind.type)
        if not known.has_header:
            self._write(topic, data, now_ns, now_ns)
            return 0
        stamp_ns, node = stamp(data), ""
        if stamp_ns < 0:
            raise MessageError("its stamp is before 1970")
        if known.has_handshake and is_handshake(data):
            return 0
        if kind.type == EVENT:
            node = self._follow_event(stamp_ns, data)
        missing = self._follow(kind, stamp_ns, data)
        if not self._lockstep:
            self._write(topic, data, now_ns, stamp_ns)
        else:
            self.order.add(topic, stamp_ns, node, data)
            for held in self.order.ready():
                self._write(held.topic, held.data, held.stamp_ns, held.stamp_ns)
        return missing

    def _follow_event(self, stamp_ns: int, data: bytes) -> str:
        """Take an event, and return its node. A run's end counts only from a source, where one announced its begin."""
        kind, node = event(data)
        if kind == EventKind.STARTED:
            self._sources.add(node)
        elif kind == EventKind.FINISHED and (not self._sources or node in self._sources):
            self._finished = True
            self._end_at(stamp_ns)
        return node

    def _follow(self, topic: Topic, stamp_ns: int, data: bytes) -> int:
        """Follow the progress of the run; return how many scans are missing."""
        missing, reached, now = 0, stamp_ns, time.monotonic()
        if shape := shape_of(topic.type, data):
            if reason := time_out_of_range(shape.first_index + shape.scans, shape.rate):
                raise MessageError(reason)
            reached = stamp_ns + round(shape.scans / shape.rate * 1e9)  # after its last scan
        if shape and topic.type == BLOCK:
            self._sampled = self._sampled or now
            missing = self.continuity[topic.name].add(shape)
        if topic.in_loop:
            if not self._began:
                self._began, self._first_ns = now, stamp_ns
            self._progress = now if topic.name in self.missing_topics() else self._progress
            self._reached[topic.name] = max(reached, self._reached.get(topic.name, reached))
        return missing

    def _end_at(self, stamp_ns: int) -> None:
        """Take the instant at which the recording ends; the earliest counts."""
        self._end_ns = stamp_ns if self._end_ns is None else min(stamp_ns, self._end_ns)
        self._ended = self._progress = time.monotonic()

    def missing_topics(self) -> list[str]:
        """Return the topics that have not reached the end of a finished run; none before."""
        if self._end_ns is None:
            return []
        return [name for name, reached in self._reached.items() if reached < self._end_ns - _SAME_INSTANT]

    @property
    def complete(self) -> bool:
        """Whether the run has finished and every topic that took part has reached its end, or is silent."""
        if self._end_ns is None or not self.recording:
            return False
        return not self.missing_topics() or time.monotonic() - self._progress > _TIMEOUT

    def result(self) -> dict[str, str]:
        """Return the results, as the bag stores them: durations [s], real-time factor, scans lost."""
        if not self._began:
            return {"finished": "no"}
        ended = self._ended or time.monotonic()
        last = max((*self._reached.values(), self._end_ns or self._first_ns))
        wall, seconds = max(ended - self._began, 1e-9), (last - self._first_ns) * 1e-9
        flows = self._recorded if self.waiting else self.continuity
        lost = {f"lost_scans {name}": str(flow.lost) for name, flow in flows.items() if flow.scans}
        return {
            "finished": "yes" if self._finished else "no",
            "wall_s": f"{wall:.3f}",
            "data_s": f"{seconds:.3f}",
            "real_time_factor": f"{seconds / wall:.3f}",
            **lost,
            **({"trigger": self.trigger_line} if self.waiting else {}),
        }

    @property
    def trigger_line(self) -> str:
        """What the recording waits for, or with which sample it began, in words; empty: there is no trigger."""
        if self.waiting is None:
            return ""
        trigger, fired = self.waiting.trigger, self.waiting.fired
        at = f"{trigger.topic} {trigger.signal} {trigger.edge} through {trigger.level:g}"
        if fired is None:
            return f"{at}: never"
        scan = "" if fired.scan is None else f" at scan {fired.scan},"
        short = "; less than trigger_pre before it: trigger_memory was full" if self.waiting.shortened else ""
        return f"{at}:{scan} {fired.time_ns * 1e-9:.6f} s, {fired.value:g}{short}"

    def end_chunk(self) -> None:
        """Make sure that a crash from now on loses only what comes later. Raises BagError."""
        if self.recording:
            self.writer.end_chunk()

    def sync(self) -> None:
        """Make sure that a power cut from now on loses only what comes later. Raises BagError."""
        if self.recording:
            self.writer.sync()

    def keep(self, name: str, data: bytes) -> None:
        """Keep a file in the bag, verbatim. Raises BagError."""
        if self.recording:
            self.writer.attach(name, data)

    def close(self) -> None:
        """Write what still waits, the result and the index; twice does nothing. Raises BagError."""
        if not self.recording:
            return
        for held in self.order.rest():
            self._write(held.topic, held.data, held.stamp_ns, held.stamp_ns)
        self.writer.close(self.result())

    def _write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        if self.waiting is None:
            self._put(topic, data, log_ns, publish_ns)
            return
        for held in self.waiting.push(topic, data, log_ns, publish_ns):
            if held.topic in self._recorded:
                self._recorded[held.topic].add(block_shape(held.data))
            self._put(held.topic, held.data, held.log_ns, held.publish_ns)
        if self.waiting.stop_ns is not None and self._end_ns is None:
            self._end_at(self.waiting.stop_ns)

    def _put(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        if topic not in self.writer.channels:
            self.writer.add_topic(topic, self.topics[topic].type, self._offered(topic))
        self.writer.write(topic, data, log_ns, publish_ns)
        self.written[topic] += 1


class DiskWatch:
    """Finds when writing begins to keep the recorder waiting, and when it no longer does.

    Where slow writes soon come back, each time twice as long has to pass without one, so that a disk that is busy for
    an hour is a few reports, not thousands.
    """

    def __init__(self, slow: float, again: float, longest: float) -> None:
        """Call a write slow that takes longer than `slow` [s], and the disk well after `again` to `longest` [s]."""
        self._slow, self._least, self._most = slow, again, longest
        self._again = again
        self._until, self._well = 0.0, -longest  # when it will be well, 0: it is; since when it is [s]
        self.longest = 0.0  # write [s]

    def push(self, took: float, now: float) -> bool | None:
        """Take how long a write took [s]; return True where slow ones begin, False where they end, else None."""
        self.longest = max(self.longest, took)
        if took > self._slow:
            before = self._until
            if not before:
                self._again = min(2.0 * self._again, self._most) if now - self._well < self._most else self._least
            self._until = now + self._again
            return None if before else True
        if self._until and now > self._until:
            self._until, self._well = 0.0, now
            return False
        return None
