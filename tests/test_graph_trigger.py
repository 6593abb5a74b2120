# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole graph with a recorder that begins by a trigger and splits its bag."""

from pathlib import Path

import numpy as np
import pytest
from graph_runs import parameters, scene_file

from atpid_control.runs.check import check
from atpid_control.runs.read import open_bag
from atpid_control.runs.verify import verify
from atpid_control.stand.domain import own_domain
from atpid_control.stand.running import run_lockstep

LASER = "/sensors/laser"


@pytest.mark.slow
def test_the_bench_is_recorded_from_before_the_level_on(scenes: Path, tmp_path: Path) -> None:
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, duration=6.0, steady_window=[5.0, 6.0])
    _, started = parameters(path, tmp_path / "run", lockstep=True)
    started["recorder_node"] |= {
        "trigger": "sensors/laser beam_displacement", "trigger_level": 0.05, "trigger_pre": 0.3, "trigger_post": 2.0,
        "max_bag_duration": 1.0,
    }  # fmt: skip
    with own_domain():
        run_lockstep(started, lambda _: None)
    folder = tmp_path / "run" / "bag"
    bag = open_bag(folder)
    assert [path.name for path in sorted(folder.glob("*.mcap"))] == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap"]
    blocks = [block for _, block in bag.messages(LASER)]
    first, last = int(blocks[0].first_index), int(blocks[-1].first_index) + 50
    column = list(blocks[0].channels).index("beam_displacement")
    beam = np.concatenate([np.asarray(one.data).reshape(-1, len(one.channels))[:, column] for one in blocks])
    (at,) = (int(word.rstrip(",")) for word in bag.result["trigger"].split() if word.rstrip(",").isdigit())
    assert beam[at - first] >= 0.05 > beam[at - first - 1]
    assert first <= at - 300 < first + 50
    assert at + 2000 < last <= at + 2050
    assert verify(folder).lost == ()
    assert check(folder).findings == []
    assert len(list(bag.messages("/excitation"))) == len(blocks)
