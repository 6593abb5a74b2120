# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands that run batches: the same options, and journals that give back what was put into them."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from atpid_sim.scene import standard_bench
from atpid_sim.simulation.batch import Workers
from atpid_sim.simulation.journal import Record, beside
from studies.cli import main
from studies.methods.run import Answer, _record
from studies.seeds.measure import SeedRun, Stage, _seed_run
from studies.thesis.measured import Measured
from studies.thesis.run import _from_plain, _to_plain, compute


@pytest.mark.parametrize("command", ["seeds", "thesis", "methods", "atlas", "extremes", "sweep"])
def test_each_command_has_the_options_of_a_batch(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    printed = capsys.readouterr().out
    assert "--workers K" in printed
    assert "--cluster ADDRESS" in printed
    assert main([command, "--workers", "0"]) == 2


def test_journals_give_back_what_was_put_in(tmp_path: Path) -> None:
    run = SeedRun("thesis_4_3", 7, (Stage(0.0, 1.0, 0.01, 0.0101, 0.2, 0.05, 0.8, 0.0),), 1, 0)
    assert _seed_run(json.loads(json.dumps(asdict(run)))) == run
    record = _record(tmp_path / "methods.journal", standard_bench())
    assert record is not None
    answer = Answer(0.2, math.inf, 3.0, "refused")
    assert record.back(json.loads(json.dumps(record.plain(answer)))) == answer
    found = Measured({"reduction": 0.7, "motion": "optimal"}, {"beam": np.array([[0.0, 1.0], [2.0, 3.0]])})
    again = _from_plain(json.loads(json.dumps(_to_plain(found))))
    assert again.values == found.values
    assert np.array_equal(again.curves["beam"], found.curves["beam"])


@pytest.mark.slow
def test_an_interrupted_study_goes_on_where_it_stopped(tmp_path: Path) -> None:
    record: Record[int, Measured] = Record(
        beside(tmp_path / "points.json"), {"inputs": 1}, lambda number: (number,), _to_plain, _from_plain
    )

    def stop(done: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="interrupted: 2 of 4 done; the same command goes on from them"):
        compute("masses", tmp_path, stop, Workers(1), record)
    seen: list[int] = []
    _, found = compute("masses", tmp_path, seen.append, Workers(1), record)
    assert seen == [2, 3, 4]
    _, whole = compute("masses", tmp_path, lambda done: None)
    assert [one.values for one in found] == [one.values for one in whole]
