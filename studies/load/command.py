# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies load`: both devices at full rate through real nodes; lost scans and processor time.

A T7 at 2 x 50 kS/s and an NI-9230 at 3 x 12.8 kS/s, their vendors' packages running on the stand-in libraries, each
node its own process, reliable blocks to a listener that checks every index, and to a recorder with `--bag`.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from atpid_interfaces.msg import CeilingState, RecorderStatus, SampleBlock
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from atpid_common.arguments import file_path, real
from atpid_common.nodes.handshake import PERIOD, empty
from atpid_common.nodes.messages import BLOCKS, STATUS
from atpid_common.nodes.node_main import initialise
from atpid_driver.standins import StandinError
from studies.load.processes import DRIVERS, INNER_STATUS, RECORDER, Processes

START_S, SETTLE_S = 30.0, 10.0
LOST = 1


@dataclass
class Tally:
    """What arrived on one topic."""

    channels: int = 0
    rate: float = 0.0  # [Hz]
    blocks: int = 0
    scans: int = 0
    next_index: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)  # (expected index, index that came)
    dropped: int = 0
    backlog: int = 0  # most scans that ever waited in device and driver
    invalid: int = 0  # values that are NaN

    def add(self, block: SampleBlock) -> None:
        """Count one block."""
        self.channels, self.rate = len(block.channels), block.rate
        if block.first_index != self.next_index:
            self.gaps.append((self.next_index, block.first_index))
        scans = len(block.data) // self.channels
        self.blocks += 1
        self.scans += scans
        self.next_index = block.first_index + scans
        self.dropped = block.dropped
        self.backlog = max(self.backlog, block.backlog)
        self.invalid += int(np.isnan(np.frombuffer(block.data)).sum())

    @property
    def lost(self) -> int:
        """Scans that did not arrive, lost anywhere on their way."""
        return self.next_index - self.scans


class Listener(Node):
    """Tallies topics, and answers the sources as loop and recorder would until data come from all of them.

    With `behind_recorder` there is a real recorder too, its status remapped to INNER_STATUS: a topic is reported as
    received once both have received it.
    """

    def __init__(self, topics: tuple[str, ...], *, behind_recorder: bool, **kwargs: Any) -> None:
        super().__init__("load_listener", **kwargs)
        self.tallies = {topic: Tally() for topic in topics}
        self._received = dict.fromkeys(topics, 0)
        self._inner: RecorderStatus | None = None
        self._behind_recorder = behind_recorder
        self._state = self.create_publisher(CeilingState, "ceiling/state", 100)
        self._status = self.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self.create_subscription(RecorderStatus, INNER_STATUS, self._on_status, STATUS)
        for topic in topics:
            self.create_subscription(
                SampleBlock, topic, lambda block, topic=topic: self._on_block(topic, block), BLOCKS
            )
        self._timer = self.create_timer(PERIOD, self._answer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def streaming(self) -> bool:
        """Whether data arrive on every topic."""
        return all(tally.blocks for tally in self.tallies.values())

    def recorder(self, field: str) -> dict[str, int]:
        """Return the recorder's count, `received` or `written`, of the blocks on each topic."""
        counts = dict(zip(self._inner.topics, getattr(self._inner, field), strict=True)) if self._inner else {}
        return {topic: int(counts.get(self.resolve_topic_name(topic), 0)) for topic in self.tallies}

    def all_recorded(self) -> bool:
        """Return whether the recorder has written every block that arrived."""
        return self.recorder("written") == {topic: tally.blocks for topic, tally in self.tallies.items()}

    def _on_status(self, status: RecorderStatus) -> None:
        self._inner = status

    def _on_block(self, topic: str, block: SampleBlock) -> None:
        self._received[topic] += 1
        if not block.handshake:
            self.tallies[topic].add(block)

    def _answer(self) -> None:
        if self.streaming:
            self._timer.cancel()
        self._state.publish(empty(CeilingState))
        elsewhere = self.recorder("received") if self._behind_recorder else dict.fromkeys(self._received, 1)
        received = [min(count, elsewhere[topic]) for topic, count in self._received.items()]
        self._status.publish(
            RecorderStatus(recording=True, topics=list(self._received), received=received, written=received)
        )


@dataclass(frozen=True)
class Result:
    """Tallies by topic; `cores`: processor time of each process over wall time; `recorded`: blocks in the bag."""

    seconds: float
    tallies: dict[str, Tally]
    cores: dict[str, float]
    recorded: dict[str, int]

    @property
    def lost(self) -> int:
        """Scans that did not arrive, and blocks the recorder did not write."""
        missing = sum(abs(self.tallies[topic].blocks - count) for topic, count in self.recorded.items())
        return missing + sum(tally.lost + tally.dropped for tally in self.tallies.values())

    @property
    def driver_cores(self) -> float:
        """Processor time of both driver processes together [cores]."""
        return sum(self.cores[name] for name in DRIVERS)


#: Arguments of the example in the help.
EXAMPLE = "--seconds 60"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "--seconds", type=real(0.0, 1e6, "s", above=True), default=60.0, help="how long to stream (default: 60)"
    )
    parser.add_argument("--bag", type=file_path, help="also record to this new folder, with atpid_control's recorder")


def run(arguments: argparse.Namespace) -> int:
    """Stream, print the table, return 1 if a scan was lost."""
    if arguments.bag is not None and os.path.lexists(arguments.bag):
        raise StandinError(f"--bag: given {arguments.bag}, which exists already; give a new folder")
    result = measure(arguments.seconds, arguments.bag)
    print(table(result))
    return LOST if result.lost else 0


def table(result: Result) -> str:
    """Return the result as text."""
    lines = [f"{'topic':24}{'channels':>9}{'rate [Hz]':>11}{'blocks':>8}{'scans':>10}{'lost':>6}{'backlog':>9}"]
    for topic, tally in result.tallies.items():
        figures = f"{tally.channels:9d}{tally.rate:11.1f}{tally.blocks:8d}{tally.scans:10d}"
        lines.append(f"{topic:24}{figures}{tally.lost + tally.dropped:6d}{tally.backlog:9d}")
    lines += [f"recorded on {topic}: {count} blocks" for topic, count in result.recorded.items()]
    costs = ", ".join(f"{name} {100 * cores:.1f} %" for name, cores in result.cores.items())
    lines.append(f"{result.seconds:.1f} s; of one core: {costs}; both drivers {100 * result.driver_cores:.1f} %")
    return "\n".join(lines)


def measure(seconds: float, bag: Path | None = None) -> Result:
    """Stream for `seconds` [s] and return what arrived. StandinError if a node does not come up."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 1 + os.getpid() % 100)
    context = Context()
    initialise([], context=context, domain_id=domain)
    listener = Listener(tuple(DRIVERS.values()), behind_recorder=bag is not None, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    with ExitStack() as ending:
        ending.callback(rclpy.shutdown, context=context)
        ending.callback(listener.destroy_node)
        ending.callback(executor.shutdown)
        processes = Processes(Path(ending.enter_context(tempfile.TemporaryDirectory())), domain, bag)
        ending.callback(processes.stop, (*DRIVERS, RECORDER))
        return _stream(executor, listener, processes, seconds)


def _stream(executor: SingleThreadedExecutor, listener: Listener, processes: Processes, seconds: float) -> Result:
    _spin(executor, START_S, lambda: listener.streaming or bool(processes.ended()))
    if processes.ended():
        raise StandinError(f"{processes.ended()} has ended: see its message above")
    if not listener.streaming:
        raise StandinError(f"no data within {START_S:g} s: is another node running in this ROS domain?")
    began, before = time.monotonic(), processes.processor_s()
    _spin(executor, seconds, lambda: False)
    elapsed, after = time.monotonic() - began, processes.processor_s()
    cores = {name: (after[name] - before[name]) / elapsed for name in before}
    processes.stop(tuple(DRIVERS))
    if RECORDER in processes.running:
        _spin(executor, SETTLE_S, listener.all_recorded)
    recorded = listener.recorder("written") if RECORDER in processes.running else {}
    return Result(elapsed, listener.tallies, cores, recorded)


def _spin(executor: SingleThreadedExecutor, seconds: float, until: Callable[[], bool]) -> None:
    """Handle messages until something has happened, at most for `seconds` [s]."""
    deadline = time.monotonic() + seconds
    while not until() and (left := deadline - time.monotonic()) > 0.0:
        executor.spin_once(timeout_sec=min(0.1, left))
