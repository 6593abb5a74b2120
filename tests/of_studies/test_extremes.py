# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Far outside the thesis's range: a named outcome, nothing infinite, no grain outside, no energy from contacts."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_mass_reference import ClosedForm, steady_amplitude

from atpid_sim.outcome import Outcome
from atpid_sim.scene import load_scene
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.simulate import simulate
from studies.cli import main
from studies.extremes.systems import broken, extreme_scene, fidelities_for, run_case

STANDARD = load_scene(Path(__file__).parents[2] / "scenes" / "standard.yaml")


@pytest.mark.slow
@given(index=st.integers(0, 100_000))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_an_extreme_system_keeps_every_guarantee(index: int) -> None:
    for fidelity in fidelities_for(7, index, ("soft", "impact")):
        case = run_case(7, index, fidelity)
        assert broken(case) == ""
        assert case.outcome in (Outcome.DONE, Outcome.OVERLAP_TOO_DEEP)
        assert case.outcome.sentence
        assert case.steps <= case.budget


def test_a_broken_guarantee_is_reported() -> None:
    case = run_case(7, 0, "impact")
    for change in (
        {"outcome": Outcome.STALLED},
        {"steps": case.budget + 1},
        {"inside": False},
        {"contact_loss": -1.0},
        {"residual": 0.2},
    ):
        assert broken(case._replace(**change)).startswith("system 0, impact: ")


def test_a_system_is_the_same_each_time() -> None:
    assert extreme_scene(3, 17) == extreme_scene(3, 17)
    assert extreme_scene(3, 17) != extreme_scene(3, 18)


@pytest.mark.parametrize(
    "contact",
    [{"law": "impact", "restitution": 1.0}, {"law": "hertz", "young_modulus": 2.1e8, "poisson_ratio": 0.2}],
    ids=["impact", "hertz"],
)
def test_an_elastic_grain_without_play_is_carried(contact: dict[str, Any]) -> None:
    scene = STANDARD.with_(contact=contact, ceiling={"height": 0.017}, duration=2.0, steady_window=[1.0, 2.0])
    integration = Integration(scene, "impact")
    state = integration.initial_state()
    assert integration.advance(state, integration.table, limit=100_000) == Outcome.DONE
    assert state.grain == pytest.approx(state.beam, abs=1e-9)


def test_the_command_writes_its_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["extremes", "--systems", "4", "--seed", "7", "--fidelities", "impact", "--out", str(tmp_path)]) == 0
    written = json.loads((tmp_path / "extremes.json").read_text())
    assert written["runs"] == 4
    assert written["broken"] == []
    assert (tmp_path / "extremes.md").read_text() in capsys.readouterr().out


@pytest.mark.slow
def test_a_million_periods_keep_their_phase() -> None:
    scene = STANDARD.with_(
        excitation={"amplitude": 0.001, "frequency": 1000.0}, ceiling={"height": 0.017}, duration=1000.0,
        steady_window=[999.9, 1000.0],
    )  # fmt: skip
    steady = steady_amplitude(ClosedForm(scene).body, 0.001, 1000.0)
    assert simulate(scene, "simplified", check=False).amplitude == pytest.approx(steady, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("fidelity", "periods"), [("impact", 1e6), ("soft", 1e5)])
def test_a_damper_works_for_hundreds_of_thousands_of_periods(fidelity: str, periods: float) -> None:
    duration = periods / STANDARD.natural_frequency_hz
    scene = STANDARD.with_(
        ceiling={"height": 0.2}, duration=duration, steady_window=[duration - 10.0, duration], tolerance=1e-4
    )
    result = simulate(scene, fidelity, check=False)
    assert result.amplitude == pytest.approx(0.0456498937, rel=5e-3)
    assert abs(result.energy_residual) < 1e-4
    assert result.steps <= Integration(scene, fidelity).step_limit
