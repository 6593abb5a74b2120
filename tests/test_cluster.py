# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Maps and studies on a Dask cluster: workers, of which some are killed, give what this machine gives."""

import json
import math
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import distributed
import numpy as np
import pytest
from graph_runs import wait_until

from atpid_common.testing import PATIENCE
from atpid_sim.maps import build_map
from atpid_sim.scene import load_scene, standard_bench
from atpid_sim.simulation.batch import ClusterError, Workers
from studies.atlas.build import build_atlas
from studies.atlas.plan import Plan
from studies.sweep.measure import standard_task, sweep

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "scenes/standard.yaml"
AMPLITUDES = [0.01, 0.012, 0.014, 0.016, 0.018, 0.02]
#: An atlas of three columns of two heights.
PLAN = Plan((0.1,), (0.005, 0.01), (0.01,), (0.98, 1.0), (0.3, 0.6))


def dask(role: str, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.dask_{role}", "--host", "127.0.0.1", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


class Cluster(NamedTuple):
    """A scheduler's address, and the processes of its workers."""

    address: str
    workers: list[subprocess.Popen[bytes]]

    def losing_one(self) -> Callable[..., None]:
        """Return what kills a worker as soon as something is done; another one is left."""
        first, _, *_ = [worker for worker in self.workers if worker.poll() is None]

        def progress(done: int, total: float = math.inf) -> None:
            if done and first.poll() is None:
                assert done < total
                first.kill()
                first.wait()

        return progress

    def lost(self) -> int:
        """How many workers are lost."""
        return sum(worker.poll() is not None for worker in self.workers)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and three workers on the loopback: two of the tests below lose one each."""
    # a port that the system chooses: one that is free now may be another's by then
    file = tmp_path_factory.mktemp("cluster") / "scheduler.json"
    common = ["--no-dashboard", "--scheduler-file", str(file)]
    processes = [dask("scheduler", "--port", "0", "--no-show", *common)]
    try:
        wait_until(lambda: file.is_file() and file.read_text().endswith("}"), processes[0])
        address = json.loads(file.read_text())["address"]
        processes += [dask("worker", "--nthreads", "1", "--no-nanny", *common) for _ in range(3)]
        with distributed.Client(address, timeout=PATIENCE, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(3, timeout=PATIENCE)
        yield Cluster(address, processes[1:])
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_a_cluster_that_loses_a_worker_gives_what_this_machine_gives(cluster: Cluster, tmp_path: Path) -> None:
    task, far, before = standard_task(0.01, 0.1, 0.2), Workers(cluster=cluster.address), cluster.lost()
    scene = load_scene(SCENE)
    made_far = build_map(scene, AMPLITUDES, [0.1], tmp_path / "far.npz", cluster.losing_one(), far)
    np.testing.assert_array_equal(made_far.heights, build_map(scene, AMPLITUDES, [0.1]).heights)
    swept = sweep(task, 0.02, 0.4, 160, 1e-4, "finite", cluster.losing_one(), far)
    assert cluster.lost() == before + 2
    np.testing.assert_array_equal(swept.amplitudes, sweep(task, 0.02, 0.4, 160, 1e-4, "finite").amplitudes)
    made = {}
    for name, workers in (("here", Workers()), ("far", far)):
        folder = tmp_path / name
        folder.mkdir()
        build_atlas(standard_bench(), PLAN, folder / "atlas.npz", workers=workers).write_tables(folder)
        lines = (folder / "atlas.csv").read_text().splitlines()
        made[name] = [line for line in lines if "_s" not in line]  # which are times
    assert made["far"] == made["here"]


@pytest.mark.parametrize("listens", [False, True])
def test_a_scheduler_without_answer_is_one_line(listens: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Nothing listens there, or something else that never answers."""
    monkeypatch.setattr("atpid_sim.simulation.batch._CONNECT_TIMEOUT", 1.0)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if listens:
            other.listen()
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ClusterError) as caught:
            build_map(load_scene(SCENE), AMPLITUDES, [0.1], tmp_path / "map.npz", workers=Workers(cluster=address))
    assert re.fullmatch(f".*--cluster.*{address}.*", str(caught.value))
