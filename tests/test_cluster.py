# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Maps and studies on a Dask cluster: two workers, one of which is killed, give what this machine gives."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import distributed
import numpy as np
import pytest
from graph_runs import wait_until

from atpid_sim.maps import build_map
from atpid_sim.scene import load_scene
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.cluster import ClusterError
from studies.cli import main
from studies.sweep.measure import standard_task, sweep
from studies.thesis.run import finished

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "scenes/standard.yaml"
AMPLITUDES = [0.01, 0.012, 0.014, 0.016, 0.018, 0.02]


def dask(role: str, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli." + role, *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers on the loopback: its address and the workers' processes."""
    file = tmp_path / "scheduler.json"  # a port that the system chooses: one that is free now may be another's by then
    on = ["--scheduler-file", str(file)]
    options = ["--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    quiet = ["--port", "0", "--no-dashboard", "--no-show"]
    processes = [dask("dask_scheduler", "--host", "127.0.0.1", *quiet, *on)]
    try:
        wait_until(lambda: file.is_file() and file.read_text().endswith("}"), processes[0])
        address = json.loads(file.read_text())["address"]
        processes += [dask("dask_worker", *options, *on) for _ in range(2)]
        with distributed.Client(address, timeout=100.0, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(2, timeout=100)
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_same_map(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, workers = cluster
    done_when_killed: list[int] = []

    def progress(done: int, total: int) -> None:
        if done >= 1 and not done_when_killed:
            workers[0].kill()
            done_when_killed.append(done)

    scene = load_scene(SCENE)
    made = build_map(scene, AMPLITUDES, [0.1], tmp_path / "far.npz", progress, Workers(cluster=address))
    here = build_map(scene, AMPLITUDES, [0.1], tmp_path / "here.npz")
    assert done_when_killed
    assert done_when_killed[0] < len(AMPLITUDES)
    np.testing.assert_array_equal(made.heights, here.heights)
    assert workers[0].wait() != 0


@pytest.mark.slow
def test_commands_on_a_cluster_that_loses_a_worker_give_what_this_machine_gives(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, workers = cluster

    def lose_one(done: int) -> None:
        if done and workers[0].poll() is None:
            workers[0].kill()
            workers[0].wait()

    task = standard_task(0.01, 0.1, 0.2)
    far = sweep(task, 0.02, 0.4, 160, 1e-4, "finite", lose_one, Workers(cluster=address))
    here = sweep(task, 0.02, 0.4, 160, 1e-4, "finite")
    assert workers[0].returncode is not None
    np.testing.assert_array_equal(far.amplitudes, here.amplitudes)
    for command, result in (("extremes --systems 10", "extremes.json"), ("atlas --quick", "atlas.csv")):
        for name, options in (("here", []), ("far", ["--cluster", address])):
            assert main([*command.split(), "--out", str(tmp_path / name), *options]) == 0
        found = [_without_times((tmp_path / name / result).read_text()) for name in ("here", "far")]
        assert found[0] == found[1]


def _without_times(text: str) -> list[str]:
    return [line for line in text.splitlines() if "_s" not in line]


@pytest.mark.slow
def test_a_study_on_a_cluster_has_the_same_rows(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    here, far = (
        finished("masses", tmp_path / name, ROOT / "scenes", lambda done: None, Workers(cluster=address))
        for name, address in (("here", None), ("far", cluster[0]))
    )
    assert far.rows == here.rows
    assert far.picture is not None
    assert far.picture.is_file()


@pytest.mark.slow
@pytest.mark.parametrize("listens", [False, True])
def test_a_scheduler_that_does_not_answer_is_one_line(
    listens: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nothing listens there, or something else that never answers."""
    monkeypatch.setattr("atpid_sim.simulation.cluster._CONNECT_TIMEOUT", 1.0)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if listens:
            other.listen()
        workers = Workers(cluster=f"tcp://127.0.0.1:{other.getsockname()[1]}")
        with pytest.raises(ClusterError, match="no Dask scheduler answers there") as caught:
            build_map(load_scene(SCENE), AMPLITUDES, [0.1], tmp_path / "map.npz", workers=workers)
    assert "\n" not in str(caught.value)
