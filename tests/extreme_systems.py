# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Systems far outside the thesis's range, and what every run of them keeps (docs/extremes.md).

Elasticity over eight decades, damping from none to five times critical, grains from a thousandth to nine times the
beam's mass, support amplitudes from a micrometre to a metre at 0.01 to 1000 Hz, weight from none to ten times the
Earth's, ceilings that close on the grain at up to 10 m/s, no clearance at all, contacts elastic and plastic.
"""

import math
from typing import Any

import numpy as np

from atpid_sim.engine import columns, drive
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.integration import OPEN, Integration, Observation

TOLERANCE = 1e-4
#: Steps after which a run is not followed further: an elastic grain may strike its walls without end.
STEPS = 30_000
#: Share of a run before the ceiling moves.
_STILL = 0.3
_RADIUS = 0.0085
_LAWS = ("tsuji", "linear", "hertz", "lee_herrmann", "kuwabara_kono", "walton_braun", "impact")


def extreme_scene(seed: int, index: int) -> Scene:
    """Return system `index` of a seed."""
    rng = np.random.default_rng((seed, index))
    law = _LAWS[int(rng.integers(len(_LAWS)))]
    frequency: Any = _spread(rng, 0.01, 1000.0) if rng.random() < 0.5 else "resonance"
    parts: dict[str, Any] = {
        "beam": {
            "mass": 0.3258,
            "stiffness": 427.6,
            "damping": float(rng.choice([0.0, 0.56, _spread(rng, 1e-3, 100.0)])),
        },
        "grain": {"mass_fraction": _spread(rng, 1e-3, 0.9), "radius": _RADIUS},
        "contact": _contact(rng, law),
        "excitation": {"amplitude": _spread(rng, 1e-6, 1.0), "frequency": frequency},
        "gravity": float(rng.choice([0.0, 9.81, rng.uniform(0.0, 100.0)])),
        "tolerance": TOLERANCE,
        "duration": 1.0,
        "ceiling": {"height": 1.0},
    }
    first = 2.0 * _RADIUS + (0.0 if rng.random() < 0.2 else _spread(rng, 1e-6, 2.0))
    second = first if rng.random() < 1.0 / 3.0 else 2.0 * _RADIUS + _spread(rng, 1e-6, 2.0)
    speed = _spread(rng, 1e-3, 10.0)
    parts["duration"] = duration = 10.0 / scene_from_mapping(parts).frequency_hz
    parts["ceiling"] = {"height": first}
    if second != first:
        begin = _STILL * duration
        parts["ceiling"] = {"profile": [[0.0, first], [begin, first], [begin + abs(second - first) / speed, second]]}
    return scene_from_mapping(parts)


def _spread(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _contact(rng: np.random.Generator, law: str) -> dict[str, Any]:
    elastic = {"law": law, "young_modulus": 2.1e8 * _spread(rng, 1e-4, 1e4), "poisson_ratio": 0.2}
    if law == "tsuji":
        return elastic | {"damping_ratio": float(rng.choice([0.0, rng.uniform(0.0, 5.0), rng.uniform(0.0, 1.0)]))}
    if law == "hertz":
        return elastic
    if law in ("lee_herrmann", "kuwabara_kono"):
        return elastic | {"damping": _spread(rng, 0.01, 1e4)}
    if law == "impact":
        return {"law": law, "restitution": float(rng.choice([0.0, 1.0, rng.random()]))}
    return {"law": law, "stiffness": _spread(rng, 1e3, 1e8), "restitution": float(rng.uniform(0.01, 1.0))}


def keep_every_guarantee(seed: int, index: int, fidelity: str) -> None:
    """Integrate one extreme system: it ends with an outcome that is allowed, sound, and with a closed ledger."""
    scene = extreme_scene(seed, index)
    try:
        integration = Integration(scene, fidelity, TOLERANCE)
    except ValueError:  # an instantaneous contact has no force to integrate
        return
    table, state = integration.table, integration.initial_state()
    first = state.copy()
    outcome = integration.advance(state, table, Observation(scene.steady_window), min(integration.step_limit, STEPS))
    followed = outcome == Outcome.STEP_BUDGET and state.steps > 0.99 * STEPS
    assert followed or outcome in (Outcome.DONE, Outcome.OVERLAP_TOO_DEEP)
    assert state.steps <= integration.step_limit
    if outcome == Outcome.OVERLAP_TOO_DEEP:
        return
    assert np.isfinite(state.y[: columns.CEILING_WORK + 1]).all()
    clearance = drive.ceiling_height(table, state.time) - 2.0 * _RADIUS
    assert -_RADIUS <= state.grain - state.beam <= clearance + _RADIUS
    ledger = integration.ledger(first, state, table)
    turnover = abs(ledger.input) + ledger.beam_loss + abs(ledger.ceiling_work) + abs(ledger.stored)
    assert ledger.contact_loss >= -1e-9 * turnover
    # a run at `finite` whose ledger is open ends with that name
    assert followed or fidelity == "finite" or abs(ledger.residual) <= OPEN
