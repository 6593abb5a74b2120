# SPDX-License-Identifier: Apache-2.0
"""Many runs on all cores give what one after the other gives."""

import threading
from pathlib import Path

import pytest

from atpid_sim.scene import load_scene
from atpid_sim.simulation.batch import cores, on_all_cores, simulate_many
from atpid_sim.simulation.simulate import simulate

SCENE = Path(__file__).parents[2] / "scenes" / "standard.yaml"


def test_many_systems_give_what_each_gives_alone() -> None:
    scene = load_scene(SCENE)
    scenes = [scene.with_(height=height) for height in (0.04, 0.08, 0.12, 0.16, 0.2)]
    together = simulate_many(scenes, "soft", check=False)
    alone = [simulate(scene, "soft", check=False) for scene in scenes]
    assert [result.amplitude for result in together] == [result.amplitude for result in alone]


def test_the_first_error_ends_the_rest() -> None:
    done = []

    def work(job: int) -> int:
        if job == 2:
            raise ArithmeticError("two")
        done.append(job)
        return job

    with pytest.raises(ArithmeticError, match="two"):
        list(on_all_cores(work, range(1000), workers=2))
    assert len(done) < 1000


def test_each_core_gets_work() -> None:
    meeting = threading.Barrier(2, timeout=100)
    jobs = dict(on_all_cores(lambda job: job == 0 or meeting.wait() >= 0, range(3), workers=2))
    assert jobs == {0: True, 1: True, 2: True}
    assert cores() >= 1
    assert list(on_all_cores(lambda job: job, [])) == []
