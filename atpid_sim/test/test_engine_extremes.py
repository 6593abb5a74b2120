# SPDX-License-Identifier: Apache-2.0
"""The engine at the edges: elastic grains that never rest, budgets, fast supports, surfaces that just meet."""

import numpy as np
import pytest

from atpid_sim.engine import state
from atpid_sim.extremes import run_case
from atpid_sim.outcome import Outcome
from atpid_sim.run import drive_table, half_peak_to_peak, initial_state, ledger_of, step_budget, stepper_of
from atpid_sim.scene import scene_from_mapping

ELASTIC = {"law": "hertz", "young_modulus": 1.6e12, "poisson_ratio": 0.2}
TSUJI = {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0}


def scene_of(contact, **changes):
    base = {
        "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
        "grain": {"mass_fraction": 0.01, "radius": 0.0085},
        "contact": contact,
        "excitation": {"amplitude": 0.01, "frequency": 0.5},
        "ceiling": {"height": 0.2},
        "gravity": 9.81,
        "duration": 20.0,
        "tolerance": 1e-4,
    }
    return scene_from_mapping(base | changes)


def ran(scene, rung, rtol=1e-4, budget=None, prepare=None):
    table = drive_table(scene, scene.steady_window)
    y, n = initial_state(scene)
    if prepare:
        prepare(y, n)
    first = y.copy()
    stepper = stepper_of(scene, rung, rtol)
    none, log = np.zeros((state.ROWS, 0)), np.zeros((0, state.COLUMNS))
    outcome = stepper(
        table, y, n, scene.steady_window, (0.0, 1.0), none, log, step_budget(scene) if budget is None else budget
    )
    return outcome, y, n, ledger_of(scene, table, first, y, int(n[state.MODE]))


def dropped(height):
    """Lift the grain before the run [m]."""

    def prepare(y, n):
        n[state.MODE] = state.FREE
        y[state.GRAIN] += height

    return prepare


@pytest.mark.parametrize("rung", ["soft", "impact"])
def test_an_elastic_grain_that_hops_too_low_to_matter_is_laid_to_rest(rung):
    """Dropped from nanometres under its weight it would hop 10^4 times a second for ever."""
    slow = {"excitation": {"amplitude": 0.6, "frequency": 0.02}, "grain": {"mass_fraction": 0.002, "radius": 0.0085}}
    scene = scene_of(ELASTIC, **slow)
    outcome, y, n, ledger = ran(scene, rung, prepare=dropped(1e-8 if rung == "soft" else 1e-10))
    assert outcome == Outcome.DONE
    assert 1000 < n[state.FLOOR_HITS] < 20_000
    assert n[state.MODE] == state.ON_FLOOR
    assert abs(ledger.residual) < 1e-6
    assert ledger.contact_loss >= 0.0
    # at rest on the floor, beam and grain are one mass
    _, alone, _, _ = ran(scene_of(ELASTIC, ceiling={"height": 0.017}, **slow), "simplified")
    assert half_peak_to_peak(y) == pytest.approx(half_peak_to_peak(alone), rel=1e-5)


@pytest.mark.parametrize("rung", ["soft", "impact"])
def test_hops_that_can_be_seen_go_on(rung):
    """Elastic hops of a tenth of a millimetre lose nothing, however many."""
    scene = scene_of(ELASTIC, excitation={"amplitude": 1e-3, "frequency": 0.5}, duration=20.0)
    outcome, y, n, ledger = ran(scene, rung, prepare=dropped(1e-4))
    assert outcome == Outcome.DONE
    assert n[state.FLOOR_HITS] > 2000
    assert n[state.LOW_HOPS] < 1000
    assert ledger.contact_loss == pytest.approx(0.0, abs=1e-9)
    assert y[state.GRAIN] != y[state.BEAM]


def test_a_lossy_grain_comes_to_rest_by_its_own_contact():
    outcome, _, n, _ = ran(scene_of(TSUJI), "soft", prepare=dropped(1e-6))
    assert outcome == Outcome.DONE
    assert n[state.FLOOR_HITS] < 10


@pytest.mark.parametrize("rung", ["soft", "impact", "simplified"])
def test_no_run_takes_more_steps_than_its_budget(rung):
    scene = scene_of(TSUJI, excitation={"amplitude": 0.05, "frequency": "resonance"})
    whole, _, n, _ = ran(scene, rung)
    assert whole == Outcome.DONE
    needed = int(state.spent(n))
    for budget in (1, 7, needed // 3, needed - 1):
        outcome, _, n, _ = ran(scene, rung, budget=budget)
        assert outcome == Outcome.STEP_BUDGET
        assert state.spent(n) <= budget


def test_a_long_run_may_take_more_steps():
    short, long = (step_budget(scene_of(TSUJI, duration=duration)) for duration in (10.0, 200_000.0))
    assert long - short == pytest.approx(1000 * 199_990.0 * scene_of(TSUJI).natural_frequency_hz, rel=1e-6)
    fast = scene_of(TSUJI, excitation={"amplitude": 1e-3, "frequency": 1000.0})
    assert step_budget(fast) > step_budget(scene_of(TSUJI))


@pytest.mark.parametrize("law", [TSUJI, ELASTIC], ids=["tsuji", "hertz"])
def test_the_ledger_closes_at_a_kilohertz(law):
    """The support's energy swings by a million times what it leaves in the beam."""
    scene = scene_of(
        law, excitation={"amplitude": 1e-4, "frequency": 1000.0}, gravity=0.0, duration=0.01,
        beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.0},
    )  # fmt: skip
    outcome, _, _, ledger = ran(scene, "soft", rtol=1e-5)
    assert outcome == Outcome.DONE
    assert ledger.input > 0.0
    assert abs(ledger.residual) < 1e-4


def test_an_elastic_grain_between_near_walls_keeps_its_energy():
    """A thousand impacts of 1e-4 each would be a tenth: the contacts of an elastic grain are integrated more finely."""
    scene = scene_of(
        {"law": "hertz", "young_modulus": 1.3e9, "poisson_ratio": 0.2}, gravity=0.0, duration=3.0,
        excitation={"amplitude": 1e-4, "frequency": 3.0}, ceiling={"height": 0.019},
        beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.0},
    )  # fmt: skip

    def thrown(y, n):
        dropped(1e-3)(y, n)
        y[state.GRAIN_RATE] += 1.0

    outcome, _, n, ledger = ran(scene, "soft", prepare=thrown)
    assert outcome == Outcome.DONE
    assert n[state.FLOOR_HITS] + n[state.CEILING_HITS] > 1000
    missing = ledger.stored - (ledger.input - ledger.beam_loss - ledger.contact_loss + ledger.ceiling_work)
    assert abs(missing) < 3e-3 * 0.5 * scene.grain_mass


@pytest.mark.parametrize("system", [693, 4325, 9041])
def test_a_grain_let_go_at_the_very_surface_flies(system):
    """Lee-Herrmann without weight: rounding left it closing by 1e-17 m/s, for ever."""
    assert run_case(1, system, "soft").outcome == Outcome.DONE
