# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver load`: both devices at full rate through real nodes; lost scans and processor time.

A T7 at 2 x 50 kS/s and an NI-9230 at 3 x 12.8 kS/s, their vendors' packages running on the stand-in libraries, each
node its own process, reliable blocks to a listener that checks every index, and to a recorder with `--bag`.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from atpid_driver.nodes.load_listener import Listener, Tally
from atpid_driver.nodes.load_processes import DRIVERS, RECORDER, Processes, processor_s
from atpid_driver.standins import StandinError

START_S, SETTLE_S = 30.0, 10.0
LOST = 1


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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--seconds", type=float, default=60.0, help="how long to stream (default: 60)")
    parser.add_argument("--bag", type=Path, help="also record to this new folder, with atpid_control's recorder")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def run(arguments: argparse.Namespace) -> int:
    """Stream, print the table, return 1 if a scan was lost."""
    result = measure(arguments.seconds, arguments.bag)
    if arguments.json:
        tallies = {topic: asdict(tally) | {"lost": tally.lost} for topic, tally in result.tallies.items()}
        figures = {"seconds": result.seconds, "lost": result.lost, "cores": result.cores, "recorded": result.recorded}
        print(json.dumps(figures | {"topics": tallies}))
    else:
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
    rclpy.init(args=[], context=context, domain_id=domain)
    listener = Listener(tuple(DRIVERS.values()), behind_recorder=bag is not None, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    try:
        with tempfile.TemporaryDirectory() as folder:
            processes = Processes(Path(folder), domain, bag)
            try:
                return _stream(executor, listener, processes, seconds)
            finally:
                processes.stop((*DRIVERS, RECORDER))
    finally:
        executor.shutdown()
        listener.destroy_node()
        rclpy.shutdown(context=context)


def _stream(executor: SingleThreadedExecutor, listener: Listener, processes: Processes, seconds: float) -> Result:
    _spin(executor, START_S, lambda: listener.streaming or bool(processes.ended()))
    if processes.ended():
        raise StandinError(f"{processes.ended()} has ended: see its message above")
    if not listener.streaming:
        raise StandinError(f"no data within {START_S:g} s: is another node running in this ROS domain?")
    began, before = time.monotonic(), processes.processor_s() | {"listener": processor_s(os.getpid())}
    _spin(executor, seconds, lambda: False)
    elapsed, after = time.monotonic() - began, processes.processor_s() | {"listener": processor_s(os.getpid())}
    cores = {name: (after[name] - before[name]) / elapsed for name in before}
    processes.stop(tuple(DRIVERS))
    if RECORDER in processes.running:
        _spin(executor, SETTLE_S, lambda: listener.recorded == listener.blocks)
    return Result(elapsed, listener.tallies, cores, listener.recorded if RECORDER in processes.running else {})


def _spin(executor: SingleThreadedExecutor, seconds: float, until: Callable[[], bool]) -> None:
    """Handle messages until something has happened, at most for `seconds` [s]."""
    deadline = time.monotonic() + seconds
    while not until() and (left := deadline - time.monotonic()) > 0.0:
        executor.spin_once(timeout_sec=min(0.1, left))
