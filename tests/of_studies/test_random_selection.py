# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`direct` and its margin on random systems: the draw, and a few systems of it as the study measures them."""

from pathlib import Path

import numpy as np
import pytest

from atpid_control.selection.deadline import Deadline
from atpid_control.selection.direct import guaranteed
from atpid_control.selection.margin import Robust
from atpid_sim.maps import DamperResponse, Timing
from studies.cli import main
from studies.random_selection import LAWS, Drawn, Outcome, box_points, draw, measured, scene_of, seen, table

DRAWN = draw(12, 1)


def test_the_draw_is_the_same_for_a_seed_and_covers_its_ranges() -> None:
    assert draw(12, 1) == DRAWN
    assert draw(12, 2) != DRAWN
    assert {one.law for one in DRAWN} == set(LAWS)
    assert {one.gravity for one in DRAWN} == {0.0, 9.81}
    assert any(one.ratio == 1.0 for one in DRAWN)
    assert any(one.ratio != 1.0 for one in DRAWN)


@pytest.mark.parametrize("one", DRAWN, ids=lambda one: one.law)
def test_a_scene_has_what_was_drawn(one: Drawn) -> None:
    scene = scene_of(one)
    amplitude = float(scene.excitation.amplitude_points[0][1])
    damper = DamperResponse(scene, 1e-5)
    assert damper.natural_frequency == pytest.approx(one.natural)
    assert damper.frequency == pytest.approx(one.ratio * one.natural)
    acceleration = (2.0 * np.pi * damper.frequency) ** 2 * damper.closed_amplitude(amplitude)
    assert acceleration == pytest.approx(9.81 * one.lift)
    assert damper.restitution(amplitude) == pytest.approx(one.restitution, rel=1e-6)


def test_the_box_is_looked_at_in_its_middle_at_its_ends_in_corners_and_inside() -> None:
    points = box_points()
    assert np.abs(points).max() == 1.0
    assert not points[0].any()
    assert np.array_equal(np.abs(points[1:11]).sum(axis=1), np.ones(10))


def test_without_gravity_and_with_much_restitution_the_regular_height_is_found() -> None:
    # the narrower search took an irregular height with 11 % more amplitude
    found = measured(DRAWN[6], "direct")
    assert DRAWN[6].gravity == 0.0
    assert found.best_regular
    assert found.regular
    assert found.excess <= 0.02


# behind a long irregular transient, and at the edge of a cliff: 34 % and 7 % more amplitude by the search of before
@pytest.mark.parametrize("number", [40, 56])
def test_late_wells_and_edges_of_cliffs_are_found(number: int) -> None:
    found = measured(draw(number + 1, 31)[number], "direct")
    assert found.best_regular
    assert found.regular
    assert found.excess <= 0.02


def at_share(number: int, share: float) -> tuple[DamperResponse, float, float]:
    """Return a system of seed 31, its support's amplitude [m], and the height [m] at a share of a clearance."""
    scene = scene_of(draw(number + 1, 31)[number])
    damper, amplitude = DamperResponse(scene, 1e-6), float(scene.excitation.amplitude_points[0][1])
    return damper, amplitude, damper.diameter + share * np.pi * damper.closed_amplitude(amplitude)


def test_a_slow_beating_is_not_taken_for_a_regular_motion() -> None:
    damper, amplitude, height = at_share(16, 0.205)
    assert seen(damper, amplitude, height, [(0.53, 0.0, 0.5)], 1).regular
    assert not seen(damper, amplitude, height, [(0.53, 0.0, 0.5)]).regular


def test_a_motion_of_three_or_four_periods_is_regular_where_that_is_asked_for() -> None:
    damper, amplitude, height = at_share(32, 0.1779)
    state, at_once = damper.closed_state(amplitude), ((0.0, height),)
    settled = damper.follow_on(amplitude, state, at_once, Timing(600.0, 16.0))
    later = ((state.time, height),)
    assert not settled.regular
    assert not damper.follow_on(amplitude, state.copy(), later, Timing(16.0, 16.0)).regular
    assert damper.follow_on(amplitude, state.copy(), later, Timing(16.0, 16.0, 4)).regular


def test_a_regular_motion_is_followed_to_its_cliff() -> None:
    damper, amplitude, height = at_share(56, 0.536)
    state = damper.closed_state(amplitude)
    settled = damper.follow_on(amplitude, state, ((0.0, height),), Timing(300.0, 16.0))
    cliff = damper.cliff(amplitude, state, height, 1.2 * height)
    assert cliff is not None
    assert cliff.amplitudes[0] == pytest.approx(settled.amplitude, rel=1e-3)
    assert 0.541 < (cliff.height - damper.diameter) / (np.pi * damper.closed_amplitude(amplitude)) < 0.5425
    clearance = damper.diameter + 1.01 * (cliff.height - damper.diameter)
    state = cliff.last.state
    beyond = damper.follow_on(amplitude, state, ((state.time, clearance),), Timing(300.0, 16.0))
    assert not beyond.regular


@pytest.mark.slow
def test_under_a_margin_the_motion_is_regular_in_its_box() -> None:
    found = measured(DRAWN[3], "margin")
    assert found.guaranteed
    assert not found.announced
    assert (found.irregular, found.broken) == (0, 0)


@pytest.mark.parametrize(
    ("verified", "irregular", "bound", "none"), [(9, 0, True, False), (8, 0, False, False), (9, 1, False, True)]
)
def test_a_least_efficiency_is_a_bound_only_where_all_is_verified_and_regular(
    verified: int, irregular: int, bound: bool, none: bool
) -> None:
    robust = Robust(0.2, 0.03, 0.05, 0.43219, verified, 9, irregular, 40)
    note = guaranteed(robust, Deadline(60.0)).note
    assert f"in {verified} of 9 sampled systems" in note
    assert ("no bound" not in note) == bound
    assert note.startswith("no lower height") == none
    assert "0.412" in note  # rounded down, less what lies between the systems


def test_the_table_counts_what_was_seen() -> None:
    one = DRAWN[0]
    done = [
        Outcome(one, 1.0, excess=0.01, seconds=1.0),
        Outcome(one, 1.0, excess=0.05, irregular=2, points=27, announced=True, seconds=2.0),
        Outcome(one, 1.0, failure="refused"),
    ]
    text = table(done)
    assert "| of these refused by the engine | 1 |" in text
    assert "| there `direct` within 2 % | 1 |" in text
    assert "| announced: no such height | 1 |" in text


@pytest.mark.slow
def test_the_command_puts_its_table_into_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    begin, end = "<!-- made by python -m studies random-selection -->", "<!-- end of random-selection -->"
    page.write_text(f"before\n{begin}\nold\n{end}\nafter\n", encoding="utf-8")
    assert main(["random-selection", "--systems", "1", "--seed", "2", "--only", "direct", "--page", str(page)]) == 0
    text = capsys.readouterr().out
    assert "| systems | 1 |" in text
    assert page.read_text(encoding="utf-8") == f"before\n{begin}\n{text}{end}\nafter\n"
