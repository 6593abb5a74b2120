# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The graph as processes: nothing lost, Ctrl-C closes the bag, a name exists only once."""

import signal
import subprocess
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from graph_runs import parameters, scene_file, started, wait_until

from atpid_common.nodes.messages import nanoseconds_of
from atpid_common.testing import PATIENCE
from atpid_control.runs.read import open_bag
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.stand.domain import own_domain
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import PARTS, REAL_TIME_PARTS
from atpid_control.stand.summary import lost_scans, unanswered_blocks

#: Of a bench that Ctrl-C ends.
LONG = {"duration": 600.0, "steady_window": [590.0, 600.0]}


def children(pid: int) -> dict[str, int]:
    """Return the nodes the process has started: pid by name."""
    # not from /proc/PID/task/PID/children, which leaves some out while another child ends
    commands = {}
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(FileNotFoundError, ProcessLookupError):  # it ended just now
            if int((process / "stat").read_text().rpartition(")")[2].split()[1]) == pid:
                commands[int(process.name)] = (process / "cmdline").read_bytes().decode().split("\0")
    return {Path(word).name: child for child, words in commands.items() for word in words if word.endswith("_node")}


def recording(out: Path) -> bool:
    """Whether data have reached the bag's file."""
    files = list((out / "bag").glob("*.mcap"))
    return bool(files) and files[0].stat().st_size > 500_000  # scene, map, definitions and the start take up to half


@dataclass
class Stopped:
    """What was seen of a bench in real time that two Ctrl-C have ended."""

    nodes: dict[str, int]
    status: int
    printed: str
    left: list[int]
    bag: Path


@pytest.fixture(scope="module")
def stopped(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Stopped:
    folder = tmp_path_factory.mktemp("bench")
    path, out = scene_file(scenes / "thesis_4_3.yaml", folder, **LONG), folder / "out"
    process = started("bench", str(path), "--out", str(out), "--real-time")
    try:
        wait_until(lambda: recording(out), process)
        nodes = children(process.pid)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate()
    finally:
        if process.poll() is None:
            process.terminate()
            process.communicate()
    left = [pid for pid in nodes.values() if Path(f"/proc/{pid}").exists()]
    return Stopped(nodes, process.returncode, printed, left, out / "bag")


@pytest.mark.always("the whole graph in real time, a process for each node")
def test_nothing_is_lost_in_real_time(stopped: Stopped) -> None:
    bag, run = open_bag(stopped.bag), open_run(stopped.bag)
    assert lost_scans(run) == 0
    # Ctrl-C ends the nodes one by one: blocks on their way have no answer; none before them lacks one
    last = max(nanoseconds_of(command.header.stamp) for _, command in bag.messages("/ceiling/command"))
    blocks = [(received, block) for received, block in bag.messages("/sensors/laser") if not block.handshake]
    stamps = [nanoseconds_of(block.header.stamp) for _, block in blocks]
    assert unanswered_blocks(run) <= sum(stamp > last for stamp in stamps)
    assert len(blocks) >= 80
    indices = [block.first_index for _, block in blocks]
    assert indices == list(range(0, 50 * len(blocks), 50))
    assert all(received >= stamp + 49_000_000 for (received, _), stamp in zip(blocks, stamps, strict=True))
    assert {message.height for _, message in bag.messages("/ceiling/state")} != {0.017}


def test_ctrl_c_twice_stops_every_node_and_closes_the_bag(stopped: Stopped) -> None:
    assert set(stopped.nodes) == {part.name for part in REAL_TIME_PARTS}
    assert stopped.status == 130
    assert "closed" in stopped.printed.strip().splitlines()[-1]
    assert verify(stopped.bag).by_topic["/sensors/laser"] > 0
    assert not stopped.left


def test_a_node_started_twice_ends_with_a_line(scenes: Path, tmp_path: Path) -> None:
    _, given = parameters(scenes / "thesis_4_3.yaml", tmp_path, lockstep=False)
    write_parameters(given, tmp_path / "parameters.yaml")
    parts = [part for part in PARTS if part.name in ("plant_node", "selector_node")]
    options = ["--ros-args", "--params-file", str(tmp_path / "parameters.yaml")]
    commands = [[str(part.executable), *options] for part in parts]
    with own_domain() as domain, ExitStack() as stack:
        first = [subprocess.Popen(command) for command in commands]
        for node in first:
            stack.callback(interrupted, node)
        claims = [f"@atpid/{domain}/{part.name}" for part in parts]
        wait_until(lambda: all(claim in Path("/proc/net/unix").read_text() for claim in claims))
        again = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for command in commands]
        for part, second in zip(parts, again, strict=True):
            stack.callback(interrupted, second)  # where it took the name over
            printed = second.communicate(timeout=5.0 * PATIENCE)[1].strip().splitlines()
            assert second.returncode == 2
            assert printed[-1].startswith(f"error: /{part.name} ")
        assert [node.poll() for node in first] == [None, None]
        assert [interrupted(node) for node in first] == [0, 0]


def interrupted(process: subprocess.Popen[Any]) -> int:
    """End a process by Ctrl-C, where it still runs; return its status."""
    process.send_signal(signal.SIGINT)
    return process.wait()
