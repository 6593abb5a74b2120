# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Maps and studies on a Dask cluster: workers, of which one is killed, give what this machine gives."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import distributed
import numpy as np
import pytest
from graph_runs import wait_until

from atpid_sim.maps import build_map
from atpid_sim.scene import load_scene, standard_bench
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.cluster import ClusterError
from studies.atlas.build import build_atlas
from studies.atlas.plan import Plan
from studies.cli import main
from studies.sweep.measure import standard_task, sweep
from studies.thesis.run import finished

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "scenes/standard.yaml"
AMPLITUDES = [0.01, 0.012, 0.014, 0.016, 0.018, 0.02]
#: An atlas of three columns of two heights.
PLAN = Plan((0.1,), (0.005, 0.01), (0.01,), (0.98, 1.0), (0.3, 0.6))


def dask(role: str, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli." + role, *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


class Cluster(NamedTuple):
    """A scheduler's address, and the processes of its workers."""

    address: str
    workers: list[subprocess.Popen[bytes]]

    def lose_one(self) -> None:
        """Kill the first worker that is there; another one is left."""
        first, *others = [worker for worker in self.workers if worker.poll() is None]
        assert others
        first.kill()
        first.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and three workers on the loopback: two of the tests below lose one each."""
    # a port that the system chooses: one that is free now may be another's by then
    file = tmp_path_factory.mktemp("cluster") / "scheduler.json"
    on = ["--scheduler-file", str(file)]
    options = ["--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    quiet = ["--port", "0", "--no-dashboard", "--no-show"]
    processes = [dask("dask_scheduler", "--host", "127.0.0.1", *quiet, *on)]
    try:
        wait_until(lambda: file.is_file() and file.read_text().endswith("}"), processes[0])
        address = json.loads(file.read_text())["address"]
        processes += [dask("dask_worker", *options, *on) for _ in range(3)]
        with distributed.Client(address, timeout=100.0, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(3, timeout=100)
        yield Cluster(address, processes[1:])
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_study_on_a_cluster_has_the_same_rows(cluster: Cluster, tmp_path: Path) -> None:
    here, far = (
        finished("masses", tmp_path / name, ROOT / "scenes", lambda done: None, Workers(cluster=address))
        for name, address in (("here", None), ("far", cluster.address))
    )
    assert far.rows == here.rows
    assert far.picture is not None
    assert far.picture.is_file()


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_the_same_map(cluster: Cluster, tmp_path: Path) -> None:
    done_when_killed: list[int] = []

    def progress(done: int, total: int) -> None:
        if done >= 1 and not done_when_killed:
            cluster.lose_one()
            done_when_killed.append(done)

    scene = load_scene(SCENE)
    made = build_map(scene, AMPLITUDES, [0.1], tmp_path / "far.npz", progress, Workers(cluster=cluster.address))
    here = build_map(scene, AMPLITUDES, [0.1], tmp_path / "here.npz")
    assert done_when_killed
    assert done_when_killed[0] < len(AMPLITUDES)
    np.testing.assert_array_equal(made.heights, here.heights)


@pytest.mark.slow
def test_commands_on_a_cluster_that_loses_a_worker_give_what_this_machine_gives(
    cluster: Cluster, tmp_path: Path
) -> None:
    address, lost = cluster.address, list[int]()

    def lose_one(done: int) -> None:
        if done and not lost:
            cluster.lose_one()
            lost.append(done)

    task = standard_task(0.01, 0.1, 0.2)
    far = sweep(task, 0.02, 0.4, 160, 1e-4, "finite", lose_one, Workers(cluster=address))
    here = sweep(task, 0.02, 0.4, 160, 1e-4, "finite")
    assert lost
    np.testing.assert_array_equal(far.amplitudes, here.amplitudes)
    for name, options in (("here", []), ("far", ["--cluster", address])):
        folder = tmp_path / name
        assert main(["extremes", "--systems", "4", "--out", str(folder), *options]) == 0
        atlas = build_atlas(
            standard_bench(), PLAN, folder / "atlas.npz", workers=Workers(cluster=address if options else None)
        )
        atlas.write_tables(folder)
    for result in ("extremes.json", "atlas.csv"):
        found = [_without_times((tmp_path / name / result).read_text()) for name in ("here", "far")]
        assert found[0] == found[1]


def _without_times(text: str) -> list[str]:
    return [line for line in text.splitlines() if "_s" not in line]


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
