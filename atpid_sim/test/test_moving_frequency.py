# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A tone whose frequency moves along straight ramps: u = A(t) sin(2 pi times the integral of f)."""

import math
from pathlib import Path

import numpy as np
import pytest

from atpid_sim.engine import columns, drive
from atpid_sim.scene import Scene, SceneError, scene_from_mapping, standard_bench
from atpid_sim.simulation.excitation import frequency_at, support_rows
from atpid_sim.simulation.integration import undamped_amplitude

POINTS = [[2.0, 5.2], [4.0, 5.6], [5.0, 5.6], [5.01, 5.3]]


def moving(**changes: object) -> Scene:
    """Return the standard bench with a frequency that rises, stands and falls quickly, under a growing amplitude."""
    excitation = {"amplitude": [[0.0, 0.0], [3.0, 0.01]], "frequency": POINTS}
    return standard_bench(**({"excitation": excitation, "duration": 8.0} | changes))


def test_the_support_is_the_sine_of_the_integrated_frequency() -> None:
    rows = support_rows(moving())
    times = np.arange(0.0, 8.0, 0.00137)
    fine = np.linspace(0.0, 8.0, 800_001)
    frequency = np.interp(fine, [t for t, _ in POINTS], [f for _, f in POINTS])
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * np.diff(fine))])
    amplitude = np.interp(times, [0.0, 3.0], [0.0, 0.01])
    expected = amplitude * np.sin(2.0 * math.pi * np.interp(times, fine, turns))
    found = [drive.support_displacement(rows, float(t)) for t in times]
    # 2.5e-9 by the spline, 1e-8 by the integral beside the kinks
    assert np.abs(np.array(found) - expected).max() < 5e-8 * 0.01 + 2e-7 * 0.01


def test_rows_follow_each_other_without_a_gap_or_a_jump() -> None:
    rows = support_rows(moving())
    assert rows[0, columns.START] == 0.0
    assert rows[-1, columns.END] == 8.0
    assert np.array_equal(rows[1:, columns.START], rows[:-1, columns.END])
    for t in (2.0, 3.0, 4.0, 5.0, 5.01):
        before, after = (drive.support_displacement(rows, t + side) for side in (-1e-9, 1e-9))
        assert after == pytest.approx(before, abs=2e-9)


def test_a_frequency_given_as_one_point_or_without_a_change_is_a_tone() -> None:
    tone = support_rows(standard_bench(excitation={"amplitude": 0.01, "frequency": 5.2}))
    for points in ([[3.0, 5.2]], [[0.0, 5.2], [4.0, 5.2]]):
        same = standard_bench(excitation={"amplitude": 0.01, "frequency": points})
        assert not same.frequency_moves
        assert np.array_equal(support_rows(same), tone)


def test_a_run_ends_like_that_of_its_last_frequency() -> None:
    """Closed forms: the closed damper, and its own transients gone after 24 s of the last frequency."""
    ended = moving(duration=30.0, ceiling={"height": 0.017}, steady_window=[28.0, 30.0])
    tone = standard_bench(
        excitation={"amplitude": 0.01, "frequency": 5.3}, duration=30.0, ceiling={"height": 0.017},
        steady_window=[28.0, 30.0],
    )  # fmt: skip
    assert ended.frequency_hz == 5.3
    assert undamped_amplitude(ended) == pytest.approx(undamped_amplitude(tone), rel=1e-6)


def test_frequency_at_an_instant() -> None:
    scene = moving()
    assert [frequency_at(scene, t) for t in (0.0, 3.0, 4.5, 8.0)] == pytest.approx([5.2, 5.4, 5.6, 5.3])


def test_it_survives_its_own_yaml(tmp_path: Path) -> None:
    from atpid_sim.scene import load_scene

    file = tmp_path / "scene.yaml"
    file.write_text(moving().to_yaml(), encoding="utf-8")
    assert load_scene(file) == moving()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([[0.0, 5.0], [0.0, 6.0]], "times in rising order"),
        ([[0.0, -1.0]], "from 1e-06"),
        ([[0.0]], "a pair of numbers"),
        ([], "at least 1 item"),
        ([[0.0, "fast"]], "bare number"),
    ],
)
def test_points_that_cannot_be_are_refused(given: object, words: str) -> None:
    with pytest.raises(SceneError, match=words) as refused:
        scene_from_mapping(moving().to_mapping() | {"excitation": {"amplitude": 0.01, "frequency": given}})
    assert "excitation.frequency" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_too_many_periods_of_a_moving_frequency_are_refused() -> None:
    scene = moving(excitation={"amplitude": 0.01, "frequency": [[0.0, 50.0], [1000.0, 51.0]]}, duration=1000.0)
    with pytest.raises(SceneError, match=r"excitation\.frequency: given 50\d+ periods in 1000 s; allowed: 25000"):
        support_rows(scene)
