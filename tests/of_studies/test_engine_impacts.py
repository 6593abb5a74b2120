# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fidelity impact where impacts come without end: ceilings that close, contacts at the very moment of pressing."""

import numpy as np
import pytest

from atpid_sim.engine import columns
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene
from atpid_sim.simulation.integration import Integration
from atpid_sim.simulation.simulate import simulate
from studies.sweep.measure import standard_task

SYSTEMS = 40


def with_contact(scene: Scene, restitution: float | None) -> Scene:
    return scene if restitution is None else scene.with_(contact={"law": "impact", "restitution": restitution})


@pytest.mark.parametrize("elastic", [False, True], ids=["tsuji", "restitution"])
def test_a_ceiling_closes_at_any_speed(elastic: bool) -> None:
    """The last of the play would be taken by impacts without end."""
    rng = np.random.default_rng(3)
    for _ in range(SYSTEMS):
        speed, height = 10.0 ** rng.uniform(-2.0, 1.0), rng.uniform(0.05, 0.5)
        closed = 2.0 + (height - 0.017) / speed
        scene = standard_task(10.0 ** rng.uniform(-2.7, -1.1), rng.uniform(0.025, 0.3), 0.1).with_(
            ceiling={"profile": [[0.0, height], [2.0, height], [closed, 0.017]]},
            duration=closed + 3.0, steady_window=[closed + 1.0, closed + 3.0],
        )  # fmt: skip
        result = simulate(with_contact(scene, rng.random() if elastic else None), "impact", check=False)
        assert abs(result.energy_residual) < 1e-6


def test_a_grain_sticks_in_a_closed_damper() -> None:
    scene = standard_task(0.01, 0.1, 0.2).with_(
        ceiling={"profile": [[0.0, 0.2], [7.0, 0.2], [7.183, 0.017]]}, tolerance=1e-2
    )
    soft, impact = simulate(scene, "soft", check=False), simulate(scene, "impact", check=False)
    assert impact.amplitude == pytest.approx(soft.amplitude, rel=2e-3)


@pytest.mark.parametrize("restitution", [None, 0.0, 0.3, 0.9])
def test_a_sweep_is_carried(restitution: float | None) -> None:
    """A grain that touches as the wall begins to press, to within rounding, comes to rest."""
    rng = np.random.default_rng(4)
    for _ in range(SYSTEMS // 2):
        first, last = rng.uniform(3.0, 8.0, 2)
        scene = standard_task(0.01, 0.1, 0.2).with_(
            excitation={"sweep": {"amplitude": 0.01, "from": float(first), "to": float(last), "duration": 10.0}},
            ceiling={"height": float(rng.uniform(0.03, 0.4))}, duration=12.0, steady_window=[8.0, 12.0],
        )  # fmt: skip
        simulate(with_contact(scene, restitution), "impact", check=False)


@pytest.mark.parametrize("fidelity", ["soft", "impact"])
def test_a_ceiling_that_crushes_is_followed_to_the_grain(fidelity: str) -> None:
    scene = standard_task(0.01, 0.1, 0.2)
    integration = Integration(scene, fidelity, 1e-6)
    table, state = integration.table, integration.initial_state()
    row = int(np.searchsorted(table[:, columns.START], 7.0))
    table[row, columns.CEILING_VELOCITY] = -1.0
    assert integration.advance(state, table) == Outcome.CEILING_CRUSHES
    assert state.time == pytest.approx(7.183, abs=1e-9)
