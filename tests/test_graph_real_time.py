# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The graph as processes: nothing lost, Ctrl-C closes the bag, a dead node is named, a name exists only once."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from graph_runs import in_real_time, scene_file, started, wait_until

from atpid_common.nodes.messages import nanoseconds_of
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.stand.domain import own_domain
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import PARTS, REAL_TIME_PARTS
from atpid_control.stand.summary import lost_scans, unanswered_blocks
from studies.soak import segments

pytestmark = pytest.mark.slow

CHANGES = {"duration": 4.0, "steady_window": [2.0, 4.0]}


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
    return bool(files) and files[0].stat().st_size > 300_000  # scene, map, definitions and the start take up to half


@pytest.fixture
def running(scenes: Path, tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A real-time bench of a minute, recording."""
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, duration=60.0, steady_window=[50.0, 60.0])
    process = started("bench", str(path), "--out", str(tmp_path / "out"), "--real-time")
    try:
        wait_until(lambda: recording(tmp_path / "out"), process)
        yield process, tmp_path / "out"
    finally:
        if process.poll() is None:
            process.terminate()
        process.communicate()


def test_nothing_is_lost_in_real_time(scenes: Path, tmp_path: Path) -> None:
    bag = in_real_time(scene_file(scenes / "thesis_4_3.yaml", tmp_path, **CHANGES), tmp_path / "run")
    assert lost_scans(open_run(bag.path)) == 0
    assert unanswered_blocks(open_run(bag.path)) == 0
    blocks = list(bag.messages("/sensors/laser"))
    assert len(blocks) == 80
    assert all(received_ns >= nanoseconds_of(block.header.stamp) + 49_000_000 for received_ns, block in blocks)
    assert {message.height for _, message in bag.messages("/ceiling/state")} != {0.017}


def test_ctrl_c_twice_stops_every_node_and_closes_the_bag(running: tuple[subprocess.Popen[str], Path]) -> None:
    process, out = running
    nodes = children(process.pid)
    assert set(nodes) == {part.name for part in REAL_TIME_PARTS}
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    _, printed = process.communicate()
    assert process.returncode == 130
    assert printed.strip().splitlines()[-1].startswith("stopped before the end; the bag is closed")
    assert verify(out / "bag").by_topic["/sensors/laser"] > 0
    assert not [pid for pid in nodes.values() if Path(f"/proc/{pid}").exists()]


def test_the_domain_is_printed_and_ctrl_c_before_the_recording_leaves_no_bag(scenes: Path, tmp_path: Path) -> None:
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **CHANGES)
    process = started("bench", str(path), "--out", str(tmp_path / "out"), "--real-time")
    printed = ""
    assert process.stderr is not None
    while not printed.startswith("ROS domain "):  # printed before the nodes are started
        printed = process.stderr.readline()
        assert printed, "it ended"
    process.send_signal(signal.SIGINT)
    _, rest = process.communicate()
    number = printed.split()[2].rstrip(":")
    assert printed.strip() == f"ROS domain {number}: listen with ROS_DOMAIN_ID={number}"
    assert process.returncode == 130
    bag = tmp_path / "out" / "bag"
    expected = "the bag is closed" if bag.exists() else "stopped before the recording began; there is no bag"
    assert expected in rest.strip().splitlines()[-1]


def test_a_node_that_dies_stops_the_run_with_its_name(running: tuple[subprocess.Popen[str], Path]) -> None:
    process, out = running
    motor = children(process.pid)["motor_node"]
    assert not segments.used_by(motor), "shared memory, which a killed node leaves behind"
    os.kill(motor, signal.SIGKILL)
    _, printed = process.communicate()
    assert process.returncode == 2
    assert printed.strip().splitlines()[-1].startswith("error: motor_node ended with status -9: ")
    assert verify(out / "bag").by_topic["/sensors/laser"] > 0


@pytest.mark.parametrize("name", ["plant_node", "selector_node"])
def test_a_node_started_twice_ends_with_a_line(scenes: Path, tmp_path: Path, name: str) -> None:
    from graph_runs import parameters

    _, given = parameters(scenes / "thesis_4_3.yaml", tmp_path, lockstep=False)
    write_parameters(given, tmp_path / "parameters.yaml")
    part = next(part for part in PARTS if part.name == name)
    command = [str(part.executable), "--ros-args", "--params-file", str(tmp_path / "parameters.yaml")]
    with own_domain():
        first = subprocess.Popen(command)
        try:
            socket = f"@atpid/{os.environ['ROS_DOMAIN_ID']}/{name}"
            wait_until(lambda: socket in Path("/proc/net/unix").read_text())
            second = subprocess.run(command, capture_output=True, text=True, check=False)
            assert second.returncode == 2
            assert second.stderr.strip().splitlines()[-1].startswith(f"error: /{name} is already running")
            assert first.poll() is None
        finally:
            first.send_signal(signal.SIGINT)
            assert first.wait() == 0
