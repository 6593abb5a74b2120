# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The trade-off: what is on the front, what is answered, and that a level meets its tolerance on a short scene."""

import math
from pathlib import Path

import numpy as np
import pytest

from atpid_sim.figure_numbers import numbers_in
from atpid_sim.scene import load_scene
from studies.baselines import BASELINES, run_baseline
from studies.tradeoff.command import _MARKERS, _answer, _draw, _markdown, _steady
from studies.tradeoff.measure import (
    OURS,
    REFERENCE,
    STEADY_ERROR,
    Point,
    Reference,
    _error_as_read,
    _Timed,
    answers,
    measure,
    reference_of,
    steady_trade,
    tightest,
    with_front,
)

SCENES = Path(__file__).parents[2] / "scenes"
STANDARD = load_scene(SCENES / "standard.yaml")
SHORT = STANDARD.with_(
    duration=1.6, steady_window=[1.2, 1.6], ceiling={"closed": 0.017, "open": 0.1, "start": 0.6, "end": 0.7}
)


def point(method: str, tolerance: float, time: float, error: float) -> Point:
    return Point(method, tolerance, time, 0.05, error, error, 1e-6, "")


POINTS = [
    point("impact", 1e-3, 0.4e-3, 4e-3),
    point("soft", 1e-4, 2e-3, 1e-4),
    point("soft", 1e-6, 3e-3, 5e-7),
    point("lsoda", 1e-4, 0.1, 5e-7),  # by chance: the next finer one is worse
    point("lsoda", 1e-5, 0.15, 2e-5),
    point("lsoda", 1e-7, 0.3, 2e-7),
]


def test_the_front_is_what_nothing_beats() -> None:
    assert [p.front for p in with_front(POINTS)] == [True, True, True, False, False, True]


def test_the_answers_name_the_quickest_that_stays_within_the_error() -> None:
    percent, permille, _, millionth = answers(POINTS)
    assert (percent["run"], permille["run"], millionth["run"]) == (
        "impact, rtol 0.001", "soft, rtol 0.0001", "soft, rtol 1e-06",
    )  # fmt: skip
    assert millionth["lsoda"] == 1e-7
    assert millionth["lsoda_ratio"] == pytest.approx(100.0)
    assert millionth["odeint"] is None


def test_a_finer_run_that_reports_failure_does_not_count_against_the_coarser() -> None:
    (percent, *_) = answers([*POINTS, point("lsoda", 1e-10, 2.0, math.nan)])
    assert percent["lsoda"] == 1e-4


def test_the_tightest_error_is_one_that_both_meet() -> None:
    (both,) = tightest(POINTS)
    assert (both["of"], both["error"], both["run"], both["lsoda"]) == ("lsoda", 5e-7, "soft, rtol 1e-06", 1e-7)
    (theirs,) = tightest([*POINTS, point("soft", 1e-8, 6e-3, 1e-9)])
    assert (theirs["error"], theirs["run"], theirs["lsoda_ratio"]) == (2e-7, "soft, rtol 1e-08", pytest.approx(50.0))
    assert tightest(POINTS[:3]) == []


def test_the_table_names_what_is_missing() -> None:
    rough = [*POINTS[:3], point("lsoda", 1e-4, 0.1, 2e-5)]
    assert "not reached: 2.0e-05 at its finest run" in _answer(answers(rough)[3])
    assert "not run" in _answer(answers(rough)[3])
    assert "the tightest scipy LSODA and ours both meet" in _answer(tightest(rough)[0])
    assert "No ratio to LSODA" in _markdown("x.yaml", CHAOTIC, POINTS, [])


NONE = np.zeros(0)
CHAOTIC = Reference(0.05, 0.02, (0.045, 0.047, 0.050), NONE, NONE)
CONVERGED = Reference(0.05, 3e-11, None, NONE, NONE)


@pytest.mark.parametrize(("reference", "lowest"), [(CHAOTIC, 1e-3), (CONVERGED, 3e-13)])
def test_an_exact_hit_does_not_stretch_the_axis(reference: Reference, lowest: float, tmp_path: Path) -> None:
    _draw("x", reference, [*POINTS, point("rk4", 1e-5, 0.1, 0.0)], tmp_path / "x.png")
    (curves,) = numbers_in(tmp_path / "x.png").values()
    assert min(curve[3] for curve in curves if curve) == pytest.approx(lowest)


def test_every_method_has_a_marker_of_its_own_or_a_colour_of_its_own() -> None:
    methods = [*OURS, *BASELINES]
    assert len({(_MARKERS[number], number % 10) for number in range(len(methods))}) == len(methods)


def test_a_baseline_is_not_charged_for_how_its_motion_is_sampled() -> None:
    """Here a contact lies at the turn: read between 64 points a period, the amplitude is 2e-6 off for anybody."""
    scene = load_scene(SCENES / "sticking.yaml")
    reference, converged = reference_of(scene), _Timed(scene, "soft", REFERENCE)
    result = run_baseline(scene, "odeint", 1e-8)
    assert abs(result.amplitude / reference.amplitude - 1.0) > 1e-6
    assert _error_as_read(result, reference, converged) < 2e-7


def test_fidelities_converge_to_the_reference() -> None:
    reference = reference_of(SHORT)
    assert reference.agreement < 1e-8
    assert reference.spread is None
    found = {}
    for p in measure(SHORT, reference):
        if p.method == "lsoda":
            break
        found[p.method, p.tolerance] = p
    assert found["soft", 1e-6].amplitude_error < 1e-5
    assert found["soft", 1e-8].amplitude_error < 1e-7
    assert found["soft", 1e-6].trajectory_error < 1e-4
    assert found["finite", 1e-6].amplitude_error < 1e-3  # the damper is open for half a second: what was closed counts


def test_the_steady_motion_is_solved_for_sooner_than_waited_for() -> None:
    found = steady_trade(STANDARD)
    assert found is not None
    assert max(found.error, found.waited_error) <= STEADY_ERROR
    assert found.time_s < 0.5 * found.waited_time_s  # 0.15 on a quiet machine
    assert "ratio" in _steady(found)
    assert "No steady motion" in _steady(steady_trade(load_scene(SCENES / "irregular.yaml")))
