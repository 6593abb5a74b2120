# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies dampers`: several dampers beside scipy and stiff contacts, and wild scenes."""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from atpid_sim.scene import Scene
from studies.cli import main
from studies.dampers import command
from studies.dampers.command import Compared, compare, outcome, wild


@pytest.fixture(scope="module", autouse=True)
def _one_comparison_a_scene() -> Iterator[None]:
    """Both commands draw the same first structure, which is compared once, in less than the study's 2 s."""
    known: dict[str, Compared] = {}

    def compared(scene: Scene) -> Compared:
        short = scene.with_(duration=1.2, steady_window=[0.7, 1.2])
        text = short.to_yaml()
        if text not in known:
            known[text] = compare(short)
        return known[text]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(command, "compare", compared)
        yield


def test_structures_beside_the_references(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dampers", "--systems", "3", "--wild", "0", "--seed", "7", "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)["compared"]
    assert len(compared) == 3
    assert min(one["impacts"] for one in compared) > 50
    assert all(one["residual"] < 1e-9 and one["grains"] > 1 for one in compared)
    same = [one for one in compared if one["impacts_spread"] < 1e-4]
    assert len(same) > 1
    assert max(one["by_impacts"] for one in same) < 2e-3
    assert min(one["by_contacts"] for one in compared) < 2e-3


def test_wild_scenes_end_with_a_name_and_a_closed_ledger() -> None:
    rng = np.random.default_rng(3)
    outcomes = [outcome(wild(rng)) for _ in range(60)]
    assert set(outcomes) <= {"DONE", "OVERLAP_TOO_DEEP", "STEP_BUDGET"}
    assert outcomes.count("DONE") > 40


def test_the_tables_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dampers", "--systems", "1", "--wild", "3", "--seed", "7"]) == 0
    shown = capsys.readouterr().out
    assert "of these within 0.2 %" in shown
    assert "outcome of a wild scene" in shown
