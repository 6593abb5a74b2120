# SPDX-License-Identifier: Apache-2.0
"""The trade-off: what is on the front, what is answered, and that a rung meets its tolerance on a short scene."""

from __future__ import annotations

from pathlib import Path

import pytest

from atpid_sim.scene import load_scene
from atpid_sim.tradeoff import Point, answers, measure, reference_of, with_front

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
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
    percent, permille, millionth = answers(POINTS)
    assert (percent["run"], permille["run"], millionth["run"]) == (
        "impact, rtol 0.001", "soft, rtol 0.0001", "soft, rtol 1e-06",
    )  # fmt: skip
    assert millionth["lsoda"] == 1e-7 and millionth["lsoda_ratio"] == pytest.approx(100.0)
    assert millionth["odeint"] is None


def test_rungs_converge_to_the_reference() -> None:
    reference = reference_of(SHORT)
    assert reference.agreement < 1e-8 and reference.spread is None
    found = {}
    for p in measure(SHORT, reference):
        if p.method == "lsoda":
            break
        found[p.method, p.tolerance] = p
    assert found["soft", 1e-6].amplitude_error < 1e-5
    assert found["soft", 1e-8].amplitude_error < 1e-7
    assert found["soft", 1e-6].trajectory_error < 1e-4
