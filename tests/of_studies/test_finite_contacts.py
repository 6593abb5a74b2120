# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The level `finite`: its table against the integrated contact, its runs against `soft`, its stated error."""

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_engine_fidelities import LAWS, NAMES, scene_of
from test_model_error import drawn
from test_reproducibility import thesis_range

from atpid_sim.engine import columns, drive
from atpid_sim.engine import contact_table as table
from atpid_sim.engine import scaled_contact as scaled
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.plant.plant import Plant
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.simulation.contact_tables import table_of
from atpid_sim.simulation.fidelity import choose, finite_error
from atpid_sim.simulation.integration import Integration, Observation, impact_log
from atpid_sim.simulation.simulate import Result, simulate, trajectory
from atpid_sim.system import reduced_mass
from studies.extremes.systems import broken, fidelities_for, run_case

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")
#: Amplitude of the standard task by `soft` at 1e-12 [m].
REFERENCE = 0.0456498937487
SYSTEMS = 40


def amplitude(scene: Scene, fidelity: str, rtol: float) -> float:
    return Integration(scene, fidelity, rtol).run(Observation(scene.steady_window)).last.amplitude


@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_a_table_has_the_restitution_of_its_law(contact: dict[str, Any]) -> None:
    scene = scene_of(contact)
    made, error = table_of(system_of(scene), contact_of(scene))
    assert error < 2e-5
    found, mass = np.zeros(table.COLUMNS), reduced_mass(system_of(scene))
    for speed in (0.01, 0.5, 5.0):
        assert table.read(made, speed, 0.0, 0.0, 0.0, 0.0, 0.0, found)
        e = restitution_of(contact_of(scene), speed, mass)
        assert -found[scaled.VELOCITY] / speed == pytest.approx(e, abs=error + 2e-7)


@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_a_table_agrees_with_the_contact_it_stands_for(contact: dict[str, Any]) -> None:
    """Under a load that changes, with the beam's answer to its recoil, to second order of these."""
    scene = scene_of(contact)
    (law, p), mass = contact_of(scene), reduced_mass(system_of(scene))
    made, error = table_of(system_of(scene), contact_of(scene))
    rng = np.random.default_rng(3)
    found, exact = np.zeros(table.COLUMNS), np.zeros(scaled.RESULTS)
    taken = 0
    for _ in range(60):
        speed = math.exp(rng.uniform(math.log(0.01), math.log(10.0)))
        scale = made.time * speed**-made.exponent
        units = speed / scale ** np.arange(1, 4)
        drive_of = np.concatenate([units, [1.0 / scale, 1.0 / scale**2]]) * rng.uniform(-1e-3, 1e-3, scaled.DRIVES)
        drive_of[scaled.ACCELERATION] = rng.uniform(-0.9, 0.3) * units[0]
        if not table.read(made, speed, *drive_of, found):
            continue
        taken += 1
        assert scaled.solve_contact(law, p, mass, speed, drive_of, scale, 60.0 * scale, 1e-10, exact)
        off = (found[: scaled.RESULTS] - exact) / np.array([scale, speed * scale, speed, *[speed * scale**2] * 2, speed * scale])  # fmt: skip # noqa: E501
        assert abs(off[scaled.VELOCITY]) < 1e-4 + error
        assert abs(off[scaled.OVERLAP]) < 1e-4 + error
        assert abs(off[scaled.DURATION]) < 2e-3
    assert taken > 20


def test_one_contact_leaves_what_an_integrated_one_leaves() -> None:
    soft, finite = Integration(STANDARD, "soft", 1e-11), Integration(STANDARD, "finite", 1e-6)
    log = soft.run(Observation(STANDARD.steady_window, impacts=impact_log(500))).impacts
    for instant, _wall, _speed in log[-4:]:
        state = soft.initial_state()
        soft.advance(state, drive.between(soft.table, 0.0, instant - 2e-4))
        other, rows = state.copy(), drive.between(soft.table, instant - 2e-4, min(instant + 9e-3, 16.0))
        soft.advance(state, rows)
        finite.advance(other, rows)
        assert other.mode == state.mode == columns.FREE
        assert other.beam == pytest.approx(state.beam, abs=1e-8)
        assert other.grain == pytest.approx(state.grain, abs=1e-8)
        assert other.beam_velocity == pytest.approx(state.beam_velocity, abs=1e-6)
        assert other.grain_velocity == pytest.approx(state.grain_velocity, abs=1e-6)
        for place in (columns.INPUT, columns.BEAM_LOSS, columns.CONTACT_LOSS):
            assert other.y[place] == pytest.approx(state.y[place], abs=5e-6)


@pytest.mark.parametrize("height", [0.04, 0.08, 0.12, 0.16, 0.20])
def test_the_heights_of_the_thesis_are_within_1e_4(height: float) -> None:
    scene = STANDARD.with_(ceiling={"closed": 0.017, "open": height, "start": 6.0, "end": 7.0})
    assert amplitude(scene, "finite", 1e-4) == pytest.approx(amplitude(scene, "soft", 1e-9), rel=1e-5)


def test_the_standard_task_states_its_error_and_takes_a_third_of_the_time() -> None:
    result = simulate(STANDARD.with_(tolerance=1e-4))
    assert result.fidelity == "finite"
    assert result.reproducible
    assert abs(result.amplitude / REFERENCE - 1.0) <= min(1e-5, result.error_estimate)
    assert abs(result.energy_residual) < 1e-4
    taken: dict[str, list[float]] = {"finite": [], "soft": []}
    runs = [Integration(STANDARD, "finite", 1e-4), Integration(STANDARD, "soft", 1e-5)]  # the latter is off by 1.5e-5
    for _ in range(15):
        for run in runs:
            begin = time.thread_time()
            run.run(Observation(STANDARD.steady_window))
            taken[run.fidelity].append(time.thread_time() - begin)
    assert min(taken["finite"]) < 0.4 * min(taken["soft"])  # 0.25 on a quiet machine


def test_a_series_does_not_change_a_run() -> None:
    """Samples within contacts come from contacts integrated aside."""
    dense = trajectory(STANDARD, 4000.0, "finite", rtol=1e-4)
    exact = trajectory(STANDARD, 4000.0, "soft", rtol=1e-8)
    window = dense.time >= STANDARD.steady_window[0]
    half = 0.5 * float(np.ptp(dense.beam[window]))
    assert half == pytest.approx(amplitude(STANDARD, "finite", 1e-4), rel=1e-4)
    assert float(np.max(np.abs((dense.beam - exact.beam)[window]))) < 1e-4 * half


def test_auto_takes_the_cheapest_level_that_meets_the_tolerance() -> None:
    levels = [choose(STANDARD.with_(tolerance=tolerance)).fidelity for tolerance in (1e-2, 1e-3, 1e-4, 1e-6)]
    assert levels == ["impact", "finite", "finite", "soft"]
    assert Plant(STANDARD.with_(height=0.2, tolerance=1e-4)).integration.fidelity == "finite"
    stiff, rubber = (
        STANDARD.with_(contact={"law": "tsuji", "young_modulus": modulus, "poisson_ratio": 0.2, "damping_ratio": 1.0})
        for modulus in (2.1e8, 2.1e6)
    )
    assert finite_error(rubber) > 20.0 * finite_error(stiff)


def test_a_law_without_a_force_has_no_finite_contacts() -> None:
    scene = STANDARD.with_(contact={"law": "impact", "restitution": 0.5})
    with pytest.raises(ValueError, match="fidelity finite: the contact law impact has no force"):
        simulate(scene, "finite")
    assert choose(scene.with_(tolerance=1e-6)).fidelity == "impact"


@pytest.mark.parametrize("number", [*range(12), 24])
def test_an_extreme_system_ends_soundly(number: int) -> None:
    """Number 24 is elastic: what its contacts lose is below the error of a table, and not negative."""
    for fidelity in fidelities_for(7, number, ["finite"]):
        assert broken(run_case(7, number, fidelity)) == ""


@pytest.mark.slow
def test_what_is_called_reproducible_is_within_its_stated_error() -> None:
    def one(scene: Scene) -> tuple[Result, float]:
        return simulate(scene.with_(tolerance=1e-4), "finite"), amplitude(scene, "soft", 1e-9)

    answers = [answer for _, answer in on_all_cores(one, thesis_range(SYSTEMS, seed=11))]
    sound = [(result, exact) for result, exact in answers if result.reproducible]
    assert len(sound) > SYSTEMS / 3
    for result, exact in sound:
        assert abs(result.amplitude / exact - 1.0) <= result.error_estimate


@pytest.mark.slow
def test_what_the_level_leaves_out_is_seldom_more_than_stated() -> None:
    """From rubber to steel, contacts integrated finely, so that only the table and its use are left."""

    def one(scene: Scene) -> tuple[float, float, float]:
        exact, disturbed = (
            Integration(scene, "soft", rtol).run(Observation(scene.steady_window), disturbance=part).last.amplitude
            for rtol, part in ((1e-9, 0.0), (1e-8, 1e-6))
        )
        off = abs(amplitude(scene, "finite", 1e-8) / exact - 1.0)
        return abs(disturbed / exact - 1.0), off, finite_error(scene)

    scenes = [scene for scene in drawn(closed=False) if scene.contact.young_modulus > 1e6]  # type: ignore[attr-defined]
    answers = [answer for _, answer in on_all_cores(one, scenes)]
    shares = [off / (stated + 1e-7) for own, off, stated in answers if own < 1e-6]
    assert len(shares) > len(scenes) / 3
    assert np.mean(np.array(shares) <= 1.0) >= 0.9
