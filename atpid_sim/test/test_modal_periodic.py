# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Periodic motions of several modes and under a force: against long runs, closed forms, and one mode."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sim_program import main
from test_basin import forced
from test_modal_engine import TSUJI, scene_of

from atpid_sim.engine import columns
from atpid_sim.engine.sections import displaced_together, sections_of
from atpid_sim.maps.response import DamperResponse, Timing
from atpid_sim.periodic import Branch, Conditions, ReturnMap, SteadyState, follow_branch, solve, steady_state
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.simulation.simulate import simulate

IMPACT = {"law": "impact", "restitution": 0.3}
#: A mode so heavy that nothing moves it.
STILL = {"mass": 1e6, "frequency": 5.5, "damping_ratio": 0.05}


def found(scene: Scene, fidelity: str = "auto", rtol: float = 1e-8) -> SteadyState:
    state = steady_state(scene, fidelity, rtol).state
    assert state is not None
    return state


def settled(scene: Scene, fidelity: str) -> float:
    """Amplitude after 300 s [m]."""
    longer = scene.with_(duration=300.0, steady_window=[298.0, 300.0])
    return Integration(longer, fidelity, 1e-9).run(Observation(longer.steady_window)).last.amplitude


@pytest.mark.parametrize(
    ("drive", "modes", "law", "fidelity"),
    [
        ("support", 2, TSUJI, "soft"),
        ("support", 3, TSUJI, "finite"),
        ("support", 3, IMPACT, "impact"),
        ("force", 1, TSUJI, "soft"),
        ("force", 2, IMPACT, "impact"),
        ("force", 3, TSUJI, "soft"),
    ],
)
def test_it_is_what_the_run_settles_to(drive: str, modes: int, law: dict[str, Any], fidelity: str) -> None:
    scene = scene_of(drive, modes, 0.02 if drive == "support" else 4.0, contact=law, duration=20.0)
    state = found(scene, fidelity)
    assert len(state.impacts) > 1
    assert len(state.section) == len(state.multipliers) == 2 * modes + 2
    left_out = state.error_estimate if fidelity == "finite" else 0.0
    assert state.amplitude == pytest.approx(settled(scene, fidelity), rel=3e-8 + left_out)


def test_a_held_grain_leaves_the_joined_modes_which_decay_as_they_do() -> None:
    scene = scene_of(modes=3, ceiling={"height": 0.017}, contact=IMPACT, duration=20.0)
    state, modes = found(scene, "impact"), scene.modes
    assert modes is not None
    decay = np.exp(-0.5 * modes.joined.damping / modes.joined.mass * state.periods / scene.frequency_hz)
    assert sorted(np.abs(state.multipliers)) == pytest.approx([0.0, 0.0, *sorted(np.repeat(decay, 2))], rel=1e-6)


@pytest.mark.parametrize("fidelity", ["impact", "soft"])
def test_a_force_that_is_the_support_s_gives_the_same_motion(fidelity: str) -> None:
    law = IMPACT if fidelity == "impact" else TSUJI
    scene = standard_bench(contact=law, ceiling={"height": 0.1}, duration=20.0)
    own, same = (found(one, fidelity) for one in (scene, forced(scene)))
    assert same.amplitude == pytest.approx(own.amplitude, rel=1e-8)
    assert abs(same.multipliers[0]) == pytest.approx(abs(own.multipliers[0]), rel=1e-4)


def upward(scene: Scene) -> Branch:
    """The motion of a scene followed while the ceiling is raised."""
    state, height = found(scene, "impact"), scene.ceiling.heights[-1][1]
    integration = Integration(scene, "impact")
    conditions = Conditions(scene.excitation.amplitude_points[-1][1], scene.frequency_hz, height)
    motion = solve(ReturnMap(integration, conditions, state.phase, state.periods), state.section).motion
    assert motion is not None
    return follow_branch(integration, motion, {"height": (0.9 * height, 0.3)}, to_cliff=True)


def test_a_mode_that_nothing_moves_leaves_motion_and_cliff_where_they_are() -> None:
    scene = standard_bench(contact=IMPACT, ceiling={"height": 0.15}, duration=20.0)
    more = scene.with_(further_modes=[STILL])
    own, same = found(scene, "impact"), found(more, "impact")
    assert same.amplitude == pytest.approx(own.amplitude, rel=1e-5)
    decay = math.exp(-2.0 * math.pi * 0.05 * 5.5 / scene.frequency_hz)
    assert np.sort(np.abs(same.multipliers)) == pytest.approx(
        np.sort([*np.abs(own.multipliers), decay, decay]), rel=1e-4, abs=1e-6
    )
    cliffs = [upward(one).cliff for one in (scene, more)]
    assert cliffs[0] is not None
    assert cliffs[1] is not None
    assert cliffs[1].loss is cliffs[0].loss
    heights = [each.motion.conditions.height for each in cliffs if each is not None]
    assert heights[1] == pytest.approx(heights[0], rel=1e-4)


def test_the_cliff_is_where_simulated_motions_leave_theirs() -> None:
    scene = scene_of("force", 2, 4.0, contact=IMPACT, ceiling={"height": 0.06}, duration=20.0)
    damper = DamperResponse(scene)
    state = damper.closed_state(4.0)
    damper.follow_on(4.0, state, ((0.0, damper.diameter), (1.0, 0.06)), Timing(200, 8))
    cliff = damper.cliff(4.0, state, 0.06, 0.5)
    assert cliff is not None
    assert cliff.height < 0.5
    below = [0.5 * (cliff.heights[k] + cliff.heights[k + 1]) for k in (len(cliff.heights) // 2, -2)]
    for height in below:
        followed = damper.follow(4.0, ((0.0, 0.06), (20.0, height)), Timing(400, 20))
        assert followed.amplitude == pytest.approx(np.interp(height, cliff.heights, cliff.amplitudes), rel=2e-2)


def test_a_section_state_is_that_of_the_engine() -> None:
    sections = sections_of(3)
    section = np.arange(1.0, 9.0)
    state = sections.flying(section)
    assert state.y[sections.places] == pytest.approx(section)
    assert (state.beam, state.beam_velocity, state.grain) == (1.0 + 3.0 + 5.0, 2.0 + 4.0 + 6.0, 7.0)
    assert state.mode == columns.FREE
    moved = sections.flying(displaced_together(8)[2])
    assert moved.grain == moved.beam == 1.0


def test_the_commands_take_several_modes_and_a_force(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = scene_of("force", 2, 4.0, contact=IMPACT, ceiling={"height": 0.06}, duration=20.0)
    path = tmp_path / "s.yaml"
    path.write_text(scene.to_yaml(), encoding="utf-8")
    assert main(["simulate", str(path), "--steady", "--kick", "0.1", "--json"]) == 0
    steady = json.loads(capsys.readouterr().out)
    assert steady["amplitude"] == pytest.approx(simulate(scene.with_(duration=80.0), check=False).amplitude, rel=1e-3)
    assert len(steady["multipliers"]) == 6
    assert steady["kicked"]["drive_amplitude"] == 4.0
    assert main(["basin", str(path), "--starts", "50"]) == 0
    assert "force 4 N: " in capsys.readouterr().out
