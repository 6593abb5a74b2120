# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The baselines: orders of convergence of the tableaux, agreement with the closed form and with each other."""

from pathlib import Path

import numpy as np
import pytest
from one_mass_reference import ClosedForm

from atpid_sim.scene import load_scene
from atpid_sim.simulation.simulate import simulate
from studies.baselines import BASELINES, BaselineError, run_baseline
from studies.baselines.run import between, half_peak_to_peak
from studies.baselines.stepping import CASH_KARP, FEHLBERG, Tableau

pytestmark = pytest.mark.slow

SCENES = Path(__file__).parents[2] / "scenes"
#: A tenth of the standard problem: 1.6 s, opening from 0.6 to 0.7 s.
SHORT = load_scene(SCENES / "standard.yaml").with_(
    duration=1.6, steady_window=[1.2, 1.6], ceiling={"closed": 0.017, "open": 0.1, "start": 0.6, "end": 0.7}
)
#: A fixed step is in seconds, so rk4 has its own.
TOLERANCE = {name: 1e-8 for name in BASELINES} | {"rk4": 1e-5}


@pytest.mark.parametrize("tableau", [CASH_KARP, FEHLBERG], ids=["cash_karp", "rkf45"])
def test_tableaux_meet_the_order_conditions(tableau: Tableau) -> None:
    a, c, b, d, _ = tableau
    for weights, order in ((b, 4), (b - d, 4)):
        assert weights.sum() == pytest.approx(1.0, abs=1e-14)
        assert weights @ c == pytest.approx(1 / 2, abs=1e-14)
        assert weights @ c**2 == pytest.approx(1 / 3, abs=1e-14)
        assert weights @ (a @ c) == pytest.approx(1 / 6, abs=1e-14)
        if order == 4:
            assert weights @ c**3 == pytest.approx(1 / 4, abs=1e-14)
            assert weights @ (c * (a @ c)) == pytest.approx(1 / 8, abs=1e-14)
            assert weights @ (a @ c**2) == pytest.approx(1 / 12, abs=1e-14)
            assert weights @ (a @ (a @ c)) == pytest.approx(1 / 24, abs=1e-14)
    fifth = b if tableau is CASH_KARP else b - d
    assert fifth @ c**4 == pytest.approx(1 / 5, abs=1e-14)
    assert fifth @ (a @ (a @ (a @ c))) == pytest.approx(1 / 120, abs=1e-14)


@pytest.fixture(scope="module")
def reference() -> float:
    return run_baseline(SHORT, "cash_karp", 1e-12).amplitude


@pytest.mark.slow
@pytest.mark.parametrize("name", BASELINES)
def test_every_baseline_finds_the_same_motion(name: str, reference: float) -> None:
    result = run_baseline(SHORT, name, TOLERANCE[name])
    assert result.message == ""
    assert not result.escaped
    assert result.amplitude == pytest.approx(reference, rel=1e-3 if name == "rk4" else 1e-5)
    assert result.energy_residual < 1e-3
    assert result.evaluations > result.steps > 100
    assert result.wall_s > 0.0


@pytest.mark.parametrize("name", ["cash_karp", "rkf45", "rk4"])
def test_the_beam_alone_converges_at_the_method_s_order(name: str) -> None:
    """A grain that rests on the floor in a weak field of motion leaves the beam's closed form nearly untouched."""
    scene = SHORT.with_(height=0.5, amplitude=1e-4, contact={"law": "linear", "stiffness": 1e3, "damping": 2.0})
    grid = np.linspace(1.25, 1.55, 50)
    exact = run_baseline(scene, "cash_karp", 1e-13).beam_at(grid)
    settings = (1e-2, 5e-3) if name == "rk4" else (1e-6, 1e-8)
    errors = [np.abs(run_baseline(scene, name, value).beam_at(grid) - exact).max() for value in settings]
    assert errors[1] < errors[0] / (4.0 if name == "rk4" else 20.0)


def test_the_closed_damper_moves_as_one_mass() -> None:
    scene = load_scene(SCENES / "closed_damper.yaml").with_(duration=2.0, steady_window=[1.5, 2.0])
    result = run_baseline(scene, "cash_karp", 1e-9)
    closed = ClosedForm(scene)
    assert result.amplitude == pytest.approx(closed.amplitude(1.5, 2.0), rel=2e-4)
    grid = np.linspace(1.5, 2.0, 200)
    assert np.abs(result.beam_at(grid) - closed.at(grid).x).max() < 2e-3 * result.amplitude


def test_what_a_baseline_cannot_run_is_refused() -> None:
    with pytest.raises(BaselineError, match="method: given 'euler'; allowed: lsoda"):
        run_baseline(SHORT, "euler", 1e-6)
    with pytest.raises(BaselineError, match=r"step: given 1e-09 s, 1\.6e"):
        run_baseline(SHORT, "rk4", 1e-9)
    with pytest.raises(
        BaselineError, match=r"contact\.law: given 'impact'; allowed: a law whose force needs no memory"
    ):
        run_baseline(SHORT.with_(contact={"law": "impact", "restitution": 0.5}), "lsoda", 1e-6)


@pytest.mark.parametrize("points", [10, 40])
def test_interpolation_and_peaks_of_a_sine(points: int) -> None:
    times = np.arange(0.0, 3.0, 1.0 / points)
    angle = 2.0 * np.pi * times + 0.3
    x, v, a = np.sin(angle), 2.0 * np.pi * np.cos(angle), -((2.0 * np.pi) ** 2) * np.sin(angle)
    error = (2.0 * np.pi / points) ** 6 / 46080
    at = np.linspace(times[0], times[-1], 1001)
    assert between(at, times, x, v, a) == pytest.approx(np.sin(2.0 * np.pi * at + 0.3), abs=1.01 * error)
    assert half_peak_to_peak(times, x, v, a) == pytest.approx(1.0, abs=1.01 * error)


def test_a_window_without_a_turn_has_its_ends_as_peaks() -> None:
    times = np.linspace(0.0, 1.0, 5)
    assert half_peak_to_peak(times, times, np.ones(5), np.zeros(5)) == pytest.approx(0.5)


@pytest.mark.parametrize("law", ["linear", "lee_herrmann", "kuwabara_kono", "tsuji"])
def test_the_engine_and_a_baseline_agree_on_every_law(law: str) -> None:
    """Two programs with nothing in common but the right-hand side's formulas."""
    damping = {"linear": 20.0, "lee_herrmann": 50.0, "kuwabara_kono": 2e3}
    keys: dict[str, object] = {"stiffness": 1e5} if law == "linear" else {"young_modulus": 2.1e8, "poisson_ratio": 0.2}
    keys |= {"damping": damping[law]} if law in damping else {"damping_ratio": 0.3}
    scene = SHORT.with_(contact={"law": law, **keys})
    baseline = run_baseline(scene, "cash_karp", 1e-10).amplitude
    assert simulate(scene, "soft", rtol=1e-8, check=False).amplitude == pytest.approx(baseline, rel=1e-6)
