# SPDX-License-Identifier: Apache-2.0
"""Systems far outside the thesis's range, and what every rung makes of them (docs/extremes.md).

Elasticity over eight decades, damping from none to five times critical, grains from a thousandth to nine times the
beam's mass, support amplitudes from a micrometre to a metre at 0.01 to 1000 Hz, weight from none to ten times the
Earth's, ceilings that close on the grain at up to 10 m/s, no play at all, contacts elastic and plastic.
"""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np

from atpid_sim.contact import contact_of, restitution_of
from atpid_sim.contact.ids import IMPACT
from atpid_sim.engine import state
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.run import drive_table, initial_state, ledger_of, stepper_of
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.system import reduced_mass, system_of

#: Steps one extreme system may take.
BUDGET = 2_000_000
TOLERANCE = 1e-4
#: A run lasts ten periods of the drive, but no longer than it takes to cross the play this often.
_CROSSINGS = 20_000.0
#: Restitution above which a grain keeps its speed.
_ELASTIC = 0.8
_RADIUS = 0.0085
_LAWS = ("tsuji", "linear", "hertz", "lee_herrmann", "kuwabara_kono", "walton_braun", "impact")


class Case(NamedTuple):
    """What became of one extreme system on one rung."""

    number: int
    rung: str
    law: str
    outcome: Outcome
    steps: int
    wall_s: float
    residual: float  # of the energy ledger, relative
    contact_loss: float  # relative to the energy turned over; negative where a contact gave energy
    finite: bool
    inside: bool  # whether the grain ended between the walls, within its own radius
    shortened: bool


def extreme_scene(seed: int, index: int) -> tuple[Scene, bool]:
    """Return system `index` of a seed, and whether its run is shorter than ten periods of its drive."""
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
    draft = scene_from_mapping(parts)
    whole = 10.0 / draft.frequency_hz
    plays = min(first, second) - 2.0 * _RADIUS, max(first, second) - 2.0 * _RADIUS
    duration = min(whole, _patience(draft, *plays, speed if second != first else 0.0))
    parts["duration"] = duration
    parts["ceiling"] = {"height": first}
    if second != first:
        begin = 0.3 * duration
        parts["ceiling"] = {"profile": [[0.0, first], [begin, first], [begin + abs(second - first) / speed, second]]}
    return scene_from_mapping(parts), duration < whole


def run_case(seed: int, index: int, rung: str) -> Case:
    """Carry one extreme system by a rung; whatever happens is an outcome, never an exception."""
    scene, shortened = extreme_scene(seed, index)
    contact = contact_of(scene)
    used = "impact" if contact.law == IMPACT else rung
    table = drive_table(scene, scene.steady_window)
    y, n = initial_state(scene)
    first = y.copy()
    stepper = stepper_of(scene, used, TOLERANCE)
    none, log = np.zeros((state.ROWS, 0)), np.zeros((0, state.COLUMNS))
    begin = time.perf_counter()
    outcome = stepper(table, y, n, scene.steady_window, (0.0, 1.0), none, log, BUDGET)
    wall = time.perf_counter() - begin
    ledger = ledger_of(scene, table, first, y, int(n[state.MODE]))
    turnover = abs(ledger.input) + ledger.beam_loss + abs(ledger.ceiling_work) + abs(ledger.stored)
    finite = bool(np.isfinite(y[: state.CEILING_WORK + 1]).all())
    return Case(
        index, used, scene.contact.law, outcome, _steps(n), wall, abs(ledger.residual),
        ledger.contact_loss / turnover if turnover > 0.0 else 0.0, finite, _inside(y, table), shortened,
    )  # fmt: skip


def check(case: Case) -> None:
    """Raise NumericalFailure where a case breaks what holds for every system."""
    if case.outcome in (Outcome.STEP_BUDGET, Outcome.STALLED, Outcome.NOT_FINITE, Outcome.ESCAPED):
        raise NumericalFailure(f"system {case.number}, {case.rung}: {case.outcome.sentence}")
    if case.outcome == Outcome.DONE and not (case.finite and case.inside and case.contact_loss >= -1e-9):
        raise NumericalFailure(
            f"system {case.number}, {case.rung}: not finite, outside the walls, or energy from a contact"
        )


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


def _patience(scene: Scene, least: float, most: float, closing: float) -> float:
    """Return the time [s] in which a grain crosses its play _CROSSINGS times.

    It crosses the least play at the speed the drive's acceleration gives it there; a grain that keeps its speed from
    impact to impact does so at the speed it took up in the largest play and from the ceiling.
    """
    omega = 2.0 * math.pi * scene.frequency_hz
    natural = 2.0 * math.pi * scene.natural_frequency_hz
    amplitude = float(scene.excitation.amplitude)  # type: ignore[union-attr, arg-type]
    pace = scene.gravity + amplitude * max(min(omega, natural) ** 2, 0.1 * omega * natural)
    least = max(least, 1e-6)
    kept = 2.0 * closing + math.sqrt(2.0 * pace * max(most, least))
    elastic = restitution_of(contact_of(scene), kept, reduced_mass(system_of(scene))) > _ELASTIC
    speed = kept if elastic else math.sqrt(0.5 * pace * least)
    return _CROSSINGS * least / speed


def _steps(n: Any) -> int:
    return int(state.spent(n))


def _inside(y: Any, table: Any) -> bool:
    row = table[min(int(np.searchsorted(table[:, 0], y[state.TIME], side="right")) - 1, len(table) - 1)]
    room = row[10] + row[11] * (y[state.TIME] - row[0]) - 2.0 * _RADIUS
    lift = y[state.GRAIN] - y[state.BEAM]
    return bool(-_RADIUS <= lift <= room + _RADIUS)
