# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The engine at the edges: elastic grains without end of hops, budgets, fast supports, surfaces that just meet."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.energy import Ledger
from atpid_sim.simulation.integration import Integration, Observation
from atpid_sim.system import Array
from studies.extremes.systems import run_case

Counters = NDArray[np.int64]
#: Changes the state vector and the counters of a run before it begins.
Prepare = Callable[[Array, Counters], None]


ELASTIC: dict[str, Any] = {"law": "hertz", "young_modulus": 1.6e12, "poisson_ratio": 0.2}
TSUJI: dict[str, Any] = {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0}


def scene_of(contact: dict[str, Any], **changes: Any) -> Scene:
    base: dict[str, Any] = {
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


def ran(
    scene: Scene, fidelity: str, rtol: float = 1e-4, limit: int | None = None, prepare: Prepare | None = None
) -> tuple[Outcome, State, Ledger]:
    integration = Integration(scene, fidelity, rtol)
    state = integration.initial_state()
    if prepare:
        prepare(state.y, state.n)
    first = state.copy()
    outcome = integration.advance(state, integration.table, Observation(scene.steady_window), limit)
    return outcome, state, integration.ledger(first, state, integration.table)


def step_limit(scene: Scene) -> int:
    return Integration(scene, "soft").step_limit


def dropped(height: float) -> Prepare:
    """Raise the grain before the run [m]."""

    def prepare(y: Array, n: Counters) -> None:
        n[columns.MODE] = columns.FREE
        y[columns.GRAIN] += height

    return prepare


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_endless_micro_bounces_are_replaced_by_static_contact(fidelity: str) -> None:
    """Dropped from nanometres under its weight it would hop 10^4 times a second for ever."""
    slow = {"excitation": {"amplitude": 0.6, "frequency": 0.02}, "grain": {"mass_fraction": 0.002, "radius": 0.0085}}
    scene = scene_of(ELASTIC, **slow)
    outcome, state, ledger = ran(scene, fidelity, prepare=dropped(1e-8 if fidelity == "soft" else 1e-10))
    assert outcome == Outcome.DONE
    assert 1000 < state.floor_impacts < 20_000
    assert state.mode == columns.ON_FLOOR
    assert abs(ledger.residual) < 1e-6
    assert ledger.contact_loss >= 0.0
    # at rest on the floor, beam and grain are one mass
    _, alone, _ = ran(scene_of(ELASTIC, ceiling={"height": 0.017}, **slow), "simplified")
    assert state.amplitude == pytest.approx(alone.amplitude, rel=1e-5)


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_hops_that_can_be_seen_go_on(fidelity: str) -> None:
    """Elastic hops of a tenth of a millimetre lose nothing, however many."""
    scene = scene_of(ELASTIC, excitation={"amplitude": 1e-3, "frequency": 0.5}, duration=20.0)
    outcome, state, ledger = ran(scene, fidelity, prepare=dropped(1e-4))
    assert outcome == Outcome.DONE
    assert state.floor_impacts > 2000
    assert state.n[columns.LOW_HOPS] < 1000
    assert ledger.contact_loss == pytest.approx(0.0, abs=1e-9)
    assert state.grain != state.beam


def test_a_lossy_grain_comes_to_rest_by_its_own_contact() -> None:
    outcome, state, _ = ran(scene_of(TSUJI), "soft", prepare=dropped(1e-6))
    assert outcome == Outcome.DONE
    assert state.floor_impacts < 10


@pytest.mark.parametrize("fidelity", ["soft", "impact", "simplified"])
def test_no_run_takes_more_steps_than_its_budget(fidelity: str) -> None:
    scene = scene_of(TSUJI, excitation={"amplitude": 0.05, "frequency": "resonance"})
    whole, state, _ = ran(scene, fidelity)
    assert whole == Outcome.DONE
    needed = state.steps
    for limit in (1, 7, needed // 3, needed - 1):
        outcome, state, _ = ran(scene, fidelity, limit=limit)
        assert outcome == Outcome.STEP_BUDGET
        assert state.steps <= limit


def test_a_long_run_may_take_more_steps() -> None:
    short, long = (step_limit(scene_of(TSUJI, duration=duration)) for duration in (10.0, 200_000.0))
    assert long - short == pytest.approx(1000 * 199_990.0 * scene_of(TSUJI).natural_frequency_hz, rel=1e-5)
    fast = scene_of(TSUJI, excitation={"amplitude": 1e-3, "frequency": 1000.0})
    assert step_limit(fast) > step_limit(scene_of(TSUJI))


@pytest.mark.parametrize("law", [TSUJI, ELASTIC], ids=["tsuji", "hertz"])
def test_the_ledger_closes_at_a_kilohertz(law: dict[str, Any]) -> None:
    """The support's energy swings by a million times what it leaves in the beam."""
    scene = scene_of(
        law, excitation={"amplitude": 1e-4, "frequency": 1000.0}, gravity=0.0, duration=0.01,
        beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.0},
    )  # fmt: skip
    outcome, _, ledger = ran(scene, "soft", rtol=1e-5)
    assert outcome == Outcome.DONE
    assert ledger.input > 0.0
    assert abs(ledger.residual) < 1e-4


def test_an_elastic_grain_between_near_walls_keeps_its_energy() -> None:
    """A thousand impacts of 1e-4 each would be a tenth: the contacts of an elastic grain are integrated more finely."""
    scene = scene_of(
        {"law": "hertz", "young_modulus": 1.3e9, "poisson_ratio": 0.2}, gravity=0.0, duration=3.0,
        excitation={"amplitude": 1e-4, "frequency": 3.0}, ceiling={"height": 0.019},
        beam={"mass": 0.3258, "stiffness": 427.6, "damping": 0.0},
    )  # fmt: skip

    def thrown(y: Array, n: Counters) -> None:
        dropped(1e-3)(y, n)
        y[columns.GRAIN_VELOCITY] += 1.0

    outcome, state, ledger = ran(scene, "soft", prepare=thrown)
    assert outcome == Outcome.DONE
    assert state.floor_impacts + state.ceiling_impacts > 1000
    missing = ledger.stored - (ledger.input - ledger.beam_loss - ledger.contact_loss + ledger.ceiling_work)
    assert abs(missing) < 3e-3 * 0.5 * scene.grain_mass


@pytest.mark.parametrize("system", [693, 4325, 9041])
def test_a_grain_detached_at_the_very_surface_flies(system: int) -> None:
    """Lee-Herrmann without weight: rounding left it closing by 1e-17 m/s, for ever."""
    assert run_case(1, system, "soft").outcome == Outcome.DONE
