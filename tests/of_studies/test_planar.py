# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The planar simulation against closed forms and the straight model; the limits it was measured for."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atpid_sim.scene import scene_from_mapping
from atpid_sim.scene.plausibility import FRICTION_LIMIT, SLOPE_LIMIT
from atpid_sim.simulation.simulate import simulate
from studies.cli import main
from studies.planar import heights, motion
from studies.planar.heights import Best, best
from studies.planar.measure import Compared, System, planar, table
from studies.planar.motion import LOSS, SIDE_V, SPIN, TIP_V, Planar, Seen, advance, at_rest, seen, steady

ROOT = Path(__file__).parents[2]
#: The tip is at rest (a beam of infinite mass), the ball lies on the left wall of a wide container.
STILL = Planar(
    beam=1e12, ball=0.1, stiffness=0.0, damping=0.0, amplitude=0.0, omega=2.0 * math.pi, gravity=0.0,
    side_gravity=9.81, clearance=100.0, side_clearance=0.01, radius=0.02, restitution=0.3, friction=0.3, slope=0.0,
)  # fmt: skip
TIP, SIDE, ALONG = range(3)
ALONG_V = 5


def after(p: Planar, state: Any, time: float, step: float = 1e-4) -> Any:
    state = np.array(state, dtype=float)
    count = round(time / step)
    advance(p, state, 0.0, step, count, np.empty(count))
    return state


def lying(**values: float) -> Any:
    state = np.array([0.0, -STILL.side_clearance, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for name, value in values.items():
        state[getattr(motion, name.upper())] = value
    return state


# closed forms


def test_a_sliding_ball_is_decelerated_by_friction_until_it_rolls() -> None:
    # mu g until 5/7 of the speed is left, after 2 v / 7 mu g; then it rolls on at that
    v = 2.0
    slips = 2.0 * v / (7.0 * 0.3 * 9.81)
    half = after(STILL, lying(along_v=v), 0.5 * slips)
    assert half[ALONG_V] == pytest.approx(v - 0.3 * 9.81 * 0.5 * slips, abs=1e-3)
    rolls = after(STILL, lying(along_v=v), 3.0 * slips)
    assert rolls[ALONG_V] == pytest.approx(5.0 / 7.0 * v, rel=1e-6)
    assert abs(rolls[SPIN]) * STILL.radius == pytest.approx(rolls[ALONG_V], rel=1e-6)
    lost = 0.5 * 0.1 * v**2 * 2.0 / 7.0
    assert rolls[LOSS] == pytest.approx(lost, rel=1e-2)


def test_a_ball_rolls_with_two_sevenths_of_the_wall_s_acceleration() -> None:
    # the tip is driven by a soft spring's constant force: stiffness times its displacement at the start
    p = STILL._replace(beam=1e6, stiffness=1e-6, friction=0.5)
    state = lying(tip=-1e12)  # a = 1 m/s^2
    state[ALONG] = state[TIP] + 50.0
    found = after(p, state, 0.5)
    assert found[TIP_V] == pytest.approx(0.5, rel=1e-5)
    assert found[ALONG_V] == pytest.approx(2.0 / 7.0 * found[TIP_V], rel=1e-5)


def test_on_a_wall_too_fast_for_rolling_friction_sets_the_acceleration() -> None:
    p = STILL._replace(beam=1e6, stiffness=1e-6, friction=0.01)
    state = lying(tip=-1e12)
    state[ALONG] = state[TIP] + 50.0
    assert after(p, state, 0.5)[ALONG_V] == pytest.approx(0.01 * 9.81 * 0.5, rel=1e-4)


def test_a_free_fall_and_its_bounce() -> None:
    p = STILL._replace(side_clearance=2.0)
    state = np.array([0.0, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    falls = math.sqrt(2.0 * 2.0 / 9.81)
    assert after(p, state, 0.5)[SIDE] == pytest.approx(-0.5 * 9.81 * 0.25, rel=1e-6)
    again = after(p, state, falls + 0.1)
    assert again[SIDE_V] == pytest.approx(0.3 * 9.81 * falls - 9.81 * 0.1, abs=2e-3)
    assert again[LOSS] == pytest.approx(0.5 * 0.1 * (9.81 * falls) ** 2 * (1.0 - 0.3**2), rel=1e-3)


def energy(p: Planar, s: Any) -> float:
    """Of beam, ball and both under gravity, the support at rest [J]."""
    turning = p.inertia * p.ball * p.radius**2 * s[SPIN] ** 2
    kinetic = 0.5 * (p.beam * s[TIP_V] ** 2 + p.ball * (s[SIDE_V] ** 2 + s[ALONG_V] ** 2) + turning)
    heights = p.gravity * (p.beam * s[TIP] + p.ball * s[ALONG]) + p.side_gravity * p.ball * s[SIDE]
    return float(kinetic + 0.5 * p.stiffness * s[TIP] ** 2 + heights)


SWINGING = Planar(
    beam=1.0, ball=0.1, stiffness=(2.0 * math.pi * 5.0) ** 2, damping=0.0, amplitude=0.0, omega=2.0 * math.pi * 5.0,
    gravity=9.81, side_gravity=2.0, clearance=0.05, side_clearance=0.004, radius=0.01, restitution=1.0, friction=0.0,
    slope=3.0,
)  # fmt: skip


def test_nothing_is_lost_without_friction_by_elastic_walls_that_turn() -> None:
    start = np.array([0.06, 0.0, 0.07, 0.0, 0.0, 0.0, 0.0, 0.0])
    drift = []
    for step in (2e-5, 1e-5):
        found = after(SWINGING, start, 4.0, step)
        assert abs(found[LOSS]) < 0.02 * energy(SWINGING, start)
        drift.append(abs(energy(SWINGING, found) / energy(SWINGING, start) - 1.0))
    assert drift[1] < 0.6 * drift[0] < 0.01


def test_what_contacts_absorb_is_what_is_missing() -> None:
    p = SWINGING._replace(restitution=0.6, friction=0.3)
    start = np.array([0.06, 0.0, 0.07, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = after(p, start, 4.0, 1e-5)
    missing = energy(p, start) - energy(p, found)
    assert missing > 0.3 * energy(p, start)
    assert found[LOSS] == pytest.approx(missing, rel=2e-3)


# the straight model


@pytest.mark.parametrize(("gravity", "restitution", "share"), [(0.0, 0.2, 0.9), (9.81, 0.3, 0.6), (9.81, 0.1, 0.5)])
def test_without_friction_and_slope_the_amplitude_is_that_of_simulate(
    gravity: float, restitution: float, share: float
) -> None:
    mapping = {
        "beam": {"mass": 1.0, "frequency": 8.0, "damping_ratio": 0.015},
        "grain": {"mass_fraction": 0.1, "radius": 0.01},
        "contact": {"law": "impact", "restitution": restitution},
        "excitation": {"amplitude": 0.002, "frequency": "resonance"},
        "ceiling": {"height": 0.02 + share * 2.0 * 0.002 / math.hypot(0.1, 0.03)},
        "gravity": gravity,
        "duration": 130.0 / 7.589,
        "steady_window": [100.0 / 7.589, 130.0 / 7.589],
        "tolerance": 1e-6,
    }
    scene = scene_from_mapping(mapping)
    p = planar(scene, restitution, scene.ceiling.heights[0][1])
    theirs = simulate(scene, "impact").amplitude
    errors = [abs(seen(p, 120, steps).amplitude / theirs - 1.0) for steps in (1000, 8000)]
    assert errors[1] < 2e-3
    assert abs(at_rest(p)[TIP]) <= abs(steady(p, p.beam + p.ball)) + scene.static_deflection


# the table


def test_the_table_separates_bands_and_irregular_motions() -> None:
    def one(ratio: float, effect: float, regular: bool) -> Compared:
        straight, whole = Seen(0.2, regular, 0.0), Seen(0.2 + effect, True, 0.0)
        return Compared("friction", ratio, straight, whole, whole, 1.0)

    found = [one(0.5, 0.001, True), one(0.9, -0.03, True), one(0.5, 0.05, False), one(3.0, 0.04, True)]
    rows = [row for row in table(found).splitlines() if "| friction |" in row]
    assert rows[0] == "| friction | within the limit | 2 | 50.0 % | 1.55, 2.9 | 0.0 % | 100.0 % | 1 | 100.0 % |"
    assert rows[2].startswith("| friction | up to 5 times | 1 | 0.0 % | 4.00, 4.0 | 100.0 %")


def test_the_table_of_heights_has_medians_by_band() -> None:
    found = [Best(3.0, 0.05, 0.02, 0.9), Best(4.0, 0.07, 0.04, 1.0), Best(0.5, 0.001, 0.0, 1.0)]
    rows = heights.table(found).splitlines()[2:]
    assert rows[0] == "| within the limit | 1 | 0.1, 0.1 | 0.0, 0.0 | 1.00 |"
    assert rows[1] == "| up to 2 times | 0 | - | - | - |"
    assert rows[2] == "| up to 5 times | 2 | 6.0, 6.9 | 3.0, 3.9 | 0.95 |"


def test_at_its_own_best_height_friction_takes_less() -> None:
    # a horizontal damper of 9 g, whose smooth optimum is half a period's flight
    p = SWINGING._replace(damping=1.0, amplitude=0.0015, omega=30.0, gravity=0.0, restitution=0.3, slope=0.0)
    p = p._replace(omega=math.sqrt(p.stiffness / 1.1), clearance=0.03)
    system = System(p, 60, 9.81, abs(steady(p, 1.1)))
    found = best(system, (1, 0))
    assert found.own <= found.same
    assert found.ratio == pytest.approx(200.0 * friction_of((1, 0)) * 9.80665 / (p.omega**2 * system.closed))


def friction_of(seed: tuple[int, int]) -> float:
    return float(np.exp(np.random.default_rng(seed).uniform(math.log(0.1), math.log(0.5))))


def test_the_page_s_table_keeps_the_limit() -> None:
    """Within each limit 95 % of the regular motions lie within two points, and none moves two points more."""
    page = (ROOT / "docs" / "horizontal.md").read_text(encoding="utf-8")
    cells = [[cell.strip() for cell in line.split("|")] for line in page.splitlines()]
    rows = [row for row in cells if row[2:3] == ["within the limit"]]
    assert [row[1] for row in rows] == ["friction", "slope", "both"]
    assert all(int(row[3]) > 50 and float(row[4].rstrip(" %")) >= 95.0 for row in rows[:2])
    assert all(float(row[6].rstrip(" %")) == 0.0 for row in rows)
    assert f"{FRICTION_LIMIT:g}" in page
    assert f"{SLOPE_LIMIT:g} rad" in page


def test_the_study_puts_its_table_into_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begin, end = "<!-- made by python -m studies planar -->", "<!-- end of planar -->"
    page = tmp_path / "page.md"
    page.write_text(f"before\n\n{begin}\nold\n{end}\n\nafter\n")
    assert main(["planar", "--systems", "2", "--seed", "3", "--page", str(page)]) == 0
    text = page.read_text()
    assert text.startswith(f"before\n\n{begin}\n| left out |")
    assert text.endswith(f"{end}\n\nafter\n")
    assert "old" not in text
    assert "2 systems, seed 3." in capsys.readouterr().out
