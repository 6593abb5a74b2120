# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fidelity levels against closed forms: bounces, restitution, sticking, order of convergence, energy."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atpid_sim.engine import columns
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.energy import Ledger
from atpid_sim.simulation.integration import Integration, Observation, drive_table, impact_log
from atpid_sim.system import Array, reduced_mass

Counters = NDArray[np.int64]
#: Changes the state vector and the counters of a run before it begins.
Prepare = Callable[[Array, Counters], None]


LAWS: list[dict[str, Any]] = [
    {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 0.2},
    {"law": "hertz", "young_modulus": 2.1e8, "poisson_ratio": 0.2},
    {"law": "linear", "stiffness": 1e5, "restitution": 0.5},
    {"law": "lee_herrmann", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping": 20.0},
    {"law": "kuwabara_kono", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping": 1000.0},
    {"law": "walton_braun", "stiffness": 1e5, "restitution": 0.6},
]
NAMES = [f"{law['law']}-{index}" for index, law in enumerate(LAWS)]


def scene_of(contact: dict[str, Any], **changes: Any) -> Scene:
    base: dict[str, Any] = {
        "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
        "grain": {"mass_fraction": 0.1, "radius": 0.0085},
        "contact": contact,
        "excitation": {"amplitude": 0.01, "frequency": "resonance"},
        "ceiling": {"height": 0.2},
        "gravity": 9.81,
        "duration": 1.0,
        "tolerance": 1e-8,
    }
    return scene_from_mapping(base | changes)


def ran(
    scene: Scene, fidelity: str = "soft", rtol: float = 1e-9, prepare: Prepare | None = None
) -> tuple[Array, Counters, Array, Ledger]:
    """State, counters and impact log after a run; `prepare(y, n)` may change the start."""
    integration = Integration(scene, fidelity, rtol)
    table, state, log = drive_table(scene), integration.initial_state(), impact_log(1000)
    if prepare:
        prepare(state.y, state.n)
    first = state.copy()
    outcome = integration.advance(state, table, Observation(scene.steady_window, impacts=log), 10_000_000)
    assert outcome == Outcome.DONE, outcome.sentence
    ledger = integration.ledger(first, state, table)
    return state.y, state.n, log[: state.n[columns.IMPACTS]], ledger


def approach(speed: float) -> Prepare:
    """A grain that flies toward a floor at rest, far from any other influence."""

    def prepare(y: Array, n: Counters) -> None:
        n[columns.MODE] = columns.FREE
        y[columns.GRAIN] = y[columns.BEAM] + 1e-3
        y[columns.GRAIN_VELOCITY] = -speed

    return prepare


@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_a_bounce_has_the_restitution_of_its_law(contact: dict[str, Any]) -> None:
    # a beam so soft and heavy that it is a free mass during the contact; no gravity
    scene = scene_of(
        contact, beam={"mass": 0.3258, "stiffness": 1e-6, "damping": 0.0}, gravity=0.0, duration=0.03,
        excitation={"free": {"deflection": 0.0}}, ceiling={"height": 3.0},
    )  # fmt: skip
    y, _n, log, ledger = ran(scene, prepare=approach(0.5))
    assert len(log) == 1
    assert log[0, columns.E_SPEED] == pytest.approx(0.5, rel=1e-6)
    after = y[columns.GRAIN_VELOCITY] - y[columns.BEAM_VELOCITY]
    e = restitution_of(contact_of(scene), 0.5, reduced_mass(system_of(scene)))
    assert after / 0.5 == pytest.approx(e, rel=2e-5, abs=1e-5)
    # momentum and energy: what is lost is what restitution takes
    system = system_of(scene)
    assert system.beam_mass * y[columns.BEAM_VELOCITY] + system.grain_mass * y[columns.GRAIN_VELOCITY] == pytest.approx(
        -0.5 * system.grain_mass, rel=1e-6
    )
    taken = 0.5 * reduced_mass(system) * 0.25 * (1.0 - e * e)
    assert ledger.contact_loss == pytest.approx(taken, rel=1e-4, abs=1e-9)


def test_tsuji_restitution_is_the_published_one_at_every_speed() -> None:
    scene = scene_of(
        LAWS[0], beam={"mass": 0.3258, "stiffness": 1e-6, "damping": 0.0}, gravity=0.0, duration=0.12,
        excitation={"free": {"deflection": 0.0}}, ceiling={"height": 3.0},
    )  # fmt: skip
    for speed in (0.01, 0.1, 1.0, 5.0):
        y, *_ = ran(scene, prepare=approach(speed))
        assert (y[columns.GRAIN_VELOCITY] - y[columns.BEAM_VELOCITY]) / speed == pytest.approx(0.1463, abs=2e-4)


@pytest.mark.parametrize("fidelity", ["soft", "finite", "impact"])
@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_energy_closes_and_contacts_only_dissipate(contact: dict[str, Any], fidelity: str) -> None:
    # an elastic grain without play never comes to rest between instantaneous impacts: leave it some
    closed = 0.02 if contact["law"] == "hertz" else 0.017
    scene = scene_of(contact, ceiling={"closed": closed, "open": 0.15, "start": 0.4, "end": 0.6}, duration=2.0)
    *_, ledger = ran(scene, fidelity, 1e-8)
    assert abs(ledger.residual) <= (1e-4 if fidelity == "finite" else 1e-6)  # a table is not exact
    assert ledger.contact_loss >= 0.0
    assert ledger.beam_loss >= 0.0


@pytest.mark.parametrize("contact", LAWS, ids=NAMES)
def test_error_falls_with_the_tolerance(contact: dict[str, Any]) -> None:
    scene = scene_of(contact, duration=0.5)
    exact = ran(scene, rtol=1e-12)[0][columns.BEAM]
    errors = [abs(ran(scene, rtol=rtol)[0][columns.BEAM] - exact) for rtol in (1e-4, 1e-6, 1e-8)]
    # without damping in the contact small errors grow from bounce to bounce
    assert errors[2] <= (1e-8 if contact.get("damping_ratio", 0.0) else 1e-6)
    assert errors[2] <= 0.01 * errors[0]


def test_a_grain_at_rest_sinks_to_its_static_overlap() -> None:
    scene = scene_of(LAWS[0], excitation={"amplitude": 0.0, "frequency": "resonance"}, duration=3.0)
    y, n, _log, _ledger = ran(scene)
    k_c = contact_of(scene).parameters[0]
    assert n[columns.MODE] == columns.ON_FLOOR
    assert y[columns.BEAM] - y[columns.GRAIN] == pytest.approx((scene.grain_mass * 9.81 / k_c) ** (2 / 3), rel=1e-4)


def test_impact_fidelity_sticks_instead_of_bouncing_for_ever() -> None:
    scene = scene_of(
        LAWS[0], duration=4.0, excitation={"amplitude": 1e-4, "frequency": "resonance"}, ceiling={"height": 0.05}
    )
    y, n, log, _ = ran(scene, "impact", prepare=approach(0.3))
    assert n[columns.MODE] == columns.ON_FLOOR
    assert len(log) < 30
    assert y[columns.GRAIN] == y[columns.BEAM]


def test_a_moving_ceiling_carries_the_grain_and_its_work_is_in_the_ledger() -> None:
    scene = scene_of(LAWS[0], ceiling={"profile": [[0.0, 0.2], [0.1, 0.2], [0.3, 0.0171]]}, duration=1.0,
                     excitation={"amplitude": 0.02, "frequency": "resonance"})  # fmt: skip
    for fidelity in ("soft", "impact"):
        *_, ledger = ran(scene, fidelity, 1e-9)
        assert ledger.ceiling_work != 0.0
        assert abs(ledger.residual) <= 1e-7


def test_without_gravity_and_motion_nothing_happens() -> None:
    scene = scene_of(LAWS[0], gravity=0.0, excitation={"free": {"deflection": 0.0}})
    y, *_ = ran(scene)
    assert y[columns.BEAM] == 0.0
    assert y[columns.GRAIN] == 0.0
    assert math.isfinite(y[columns.INPUT])
