# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The step search as a state machine, and on the plant."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.selection.protocol import Excitation
from atpid_control.selection.search import Plan, SearchError, SearchSelector, StepSearch
from atpid_sim.scene import load_scene

SCENES = Path(__file__).parents[2] / "scenes"


def walk(plan: Plan, amplitude_at: Callable[[float], float]) -> StepSearch:
    search = StepSearch(plan)
    while not search.done:
        search.observe(amplitude_at(search.target))
    return search


def test_it_goes_back_when_it_gets_worse() -> None:
    search = walk(Plan(0.1, 3.0, 0.1, 1.0), lambda height: abs(height - 0.52))
    assert search.target == search.best_height == pytest.approx(0.5)
    assert search.iterations == 6


def test_it_ends_at_the_highest_height_where_that_is_best() -> None:
    search = walk(Plan(0.3, 3.0, 0.1, 1.0), lambda height: -height + 2.0)
    assert search.target == 1.0
    assert search.observe(5.0) == 1.0


@given(best=st.floats(0.05, 2.0), step=st.floats(0.01, 0.3))
def test_it_always_ends_within_a_step_of_a_single_minimum(best: float, step: float) -> None:
    search = walk(Plan(step, 1.0, 0.05, 2.0), lambda height: abs(height - best))
    assert abs(search.target - best) <= step + 1e-9
    assert 0.05 <= search.target <= 2.0


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((0.0, 3.0, 0.1, 1.0), "step"),
        ((math.nan, 3.0, 0.1, 1.0), "step"),
        ((0.1, 0.0, 0.1, 1.0), "dwell"),
        ((0.1, 3.0, 1.0, 0.1), "limits"),
        ((0.1, 3.0, math.nan, 0.1), "limits"),
    ],
)
def test_impossible_plans_are_refused(arguments: tuple[float, float, float, float], named: str) -> None:
    with pytest.raises(SearchError, match=named):
        Plan(*arguments)


def test_without_a_beam_the_search_stops() -> None:
    with pytest.raises(SearchError, match="the beam is not measured"):
        StepSearch(Plan(0.1, 3.0, 0.1, 1.0)).observe(math.nan)


def test_with_the_thesis_s_own_steps_it_finds_the_thesis_s_height() -> None:
    # a tenth of a metre every 4 s, opened in 1 s
    selector = SearchSelector(load_scene(SCENES / "standard.yaml"), Plan(0.1, 3.0, 0.1, 1.5))
    chosen = selector.select(Excitation(0.03))
    assert chosen.height == pytest.approx(0.6, abs=0.11)
    assert [stage.name for stage in chosen.stages][:2] == ["step 1", "step 2"]
    assert chosen.stages[-2].note == "worse: back"
