# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Systems far outside the thesis's range, at every fidelity (docs/research/extremes.md).

Elasticity over eight decades, damping from none to five times critical, grains from a thousandth to nine times the
beam's mass, support amplitudes from a micrometre to a metre at 0.01 to 1000 Hz, weight from none to ten times the
Earth's, ceilings that close on the grain at up to 10 m/s, no clearance at all, contacts elastic and plastic.
"""

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from atpid_sim.contact.laws import HYSTERETIC, IMPACT
from atpid_sim.engine import columns, drive
from atpid_sim.engine.detachment import static_overlap
from atpid_sim.engine.dormand_prince import ContactModel
from atpid_sim.engine.rosenbrock import contact_pace
from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.outcome import Outcome
from atpid_sim.scene import Scene, scene_from_mapping
from atpid_sim.simulation.integration import OPEN, Integration, Observation
from atpid_sim.system import reduced_mass

TOLERANCE = 1e-4
#: A run lasts ten periods of the drive, but no longer than this many crossings of the clearance or
#: vibrations on a wall.
_EVENTS = 50_000.0
#: Vibrations of the fastest of several modes, and steps, for which such a run lasts at most.
_SWINGS, _STEPS = 2000.0, 2_000_000
#: Share of a run before the ceiling moves.
_STILL = 0.3
#: Clearance below which a grain does not cross it: it is in contact all the time [m].
_LEAST_CLEARANCE = 1e-6
#: Damping rate times duration from which a vibration is over long before the end.
_FADED = 100.0
#: Restitution above which a grain keeps its speed.
_ELASTIC = 0.8
_RADIUS = 0.0085
#: How no run may end, however extreme the system is.
_NEVER = (Outcome.STEP_BUDGET, Outcome.STALLED, Outcome.NOT_FINITE, Outcome.ESCAPED, Outcome.LEDGER_OPEN)
#: Least and largest stiffness of a further mode [N/m].
_STIFFNESS = (1e-5, 1e10)
#: How one of several modes may end: a grain of 10^4 times the container's mass can leave it and touch without end.
_OF_MODES = (Outcome.STEP_BUDGET, Outcome.LEDGER_OPEN)
_LAWS = ("tsuji", "linear", "hertz", "lee_herrmann", "kuwabara_kono", "walton_braun", "impact")


class Case(NamedTuple):
    """Outcome of one extreme system at one fidelity."""

    number: int
    fidelity: str
    law: str
    outcome: Outcome
    steps: int
    budget: int
    wall_s: float
    residual: float  # of the energy ledger, relative
    contact_loss: float  # relative to the energy turned over; negative where a contact supplied energy
    finite: bool
    inside: bool  # whether the grain ended between the walls, within its own radius
    shortened: bool
    modes: bool = False


def case_of(plain: Mapping[str, Any]) -> Case:
    """Return the case of a journal's line."""
    return Case(**{**plain, "outcome": Outcome(plain["outcome"])})


def extreme_scene(seed: int, index: int, modes: bool = False) -> tuple[Scene, bool]:
    """Return system `index` of a seed, and whether its run is shorter than ten periods of its drive.

    modes: with one to eight further modes, half of these structures driven by a force.
    """
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
    if modes:
        parts |= _modes(np.random.default_rng((seed, index, 1)), draft)
        draft = scene_from_mapping(parts)
    whole = 10.0 / draft.frequency_hz
    plays = first - 2.0 * _RADIUS, second - 2.0 * _RADIUS
    duration = min(whole, _longest_duration(draft, *plays, speed if second != first else 0.0))
    parts["duration"] = duration
    parts["ceiling"] = {"height": first}
    if second != first:
        begin = _STILL * duration
        parts["ceiling"] = {"profile": [[0.0, first], [begin, first], [begin + abs(second - first) / speed, second]]}
    return scene_from_mapping(parts), duration < whole


def _modes(rng: np.random.Generator, scene: Scene) -> dict[str, Any]:
    """Return further modes beside a scene's beam, and how they are driven.

    Frequencies the same to 10^4 apart, masses of a milligram to a thousand tonnes, damping from none to five times
    critical, shares of the drive of both signs; one in eight has nearly a node at the container: a mass of 10^6 kg.
    """
    further, own = [], math.sqrt(scene.beam.stiffness / scene.beam.mass)
    for _ in range(rng.integers(1, 9)):
        node = rng.random() < 0.125
        mass = 1e6 if node else _spread(rng, 1e-6, 1e6)
        apart = 1.0 if rng.random() < 0.2 else _spread(rng, 0.1, 1e4)
        further.append({
            "mass": mass, "stiffness": float(np.clip((own * apart) ** 2 * mass, *_STIFFNESS)),
            "damping_ratio": float(rng.choice([0.0, _spread(rng, 1e-4, 1.0), rng.uniform(1.0, 5.0)])),
            "drive_factor": float(rng.choice([-1.0, 1.0])) * (1e3 if node else _spread(rng, 1e-3, 10.0)),
        })  # fmt: skip
    parts: dict[str, Any] = {"further_modes": further}
    if rng.random() < 0.5:
        tone = scene.excitation.amplitude_points[0][1]
        excitation = {"amplitude": tone * scene.beam.stiffness, "frequency": scene.frequency_hz}
        parts |= {"drive": "force", "excitation": excitation}
    return parts


def fidelities_for(seed: int, index: int, fidelities: Sequence[str], modes: bool = False) -> list[str]:
    """Return those that can integrate this system: an instantaneous contact has no force, and damping couples modes."""
    scene, _ = extreme_scene(seed, index, modes)
    return [fidelity for fidelity in fidelities if not _refused(scene, fidelity)]


def _refused(scene: Scene, fidelity: str) -> bool:
    try:
        Integration(scene, fidelity, TOLERANCE)
    except ValueError:
        return True
    return False


def run_case(seed: int, index: int, fidelity: str, modes: bool = False) -> Case:
    """Integrate one extreme system; every end is an outcome, never an exception."""
    scene, shortened = extreme_scene(seed, index, modes)
    integration = Integration(scene, fidelity, TOLERANCE)
    table, state, limit = integration.table, integration.initial_state(), integration.step_limit
    if modes:
        limit = min(limit, _STEPS)
    first = state.copy()
    begin = time.perf_counter()
    outcome = integration.advance(state, table, Observation(scene.steady_window), limit)
    wall = time.perf_counter() - begin
    ledger = integration.ledger(first, state, table)
    turnover = abs(ledger.input) + ledger.beam_loss + abs(ledger.ceiling_work) + abs(ledger.stored)
    clearance = drive.ceiling_height(table, state.time) - 2.0 * _RADIUS
    inside = -_RADIUS <= state.grain - state.beam <= clearance + _RADIUS
    if modes and outcome == Outcome.DONE and abs(ledger.residual) > OPEN:
        outcome = Outcome.LEDGER_OPEN  # as a run of the scene ends
    finite = bool(np.isfinite(state.y[: columns.CEILING_WORK + 1]).all())
    return Case(
        index, fidelity, scene.contact.law, outcome, state.steps, limit, wall, abs(ledger.residual),
        ledger.contact_loss / turnover if turnover > 0.0 else 0.0, finite, inside, shortened, modes,
    )  # fmt: skip


def broken(case: Case) -> str:
    """Return which guarantee a case breaks, in words; empty: none."""
    done = case.outcome == Outcome.DONE
    unsound = not (case.finite and case.inside and case.contact_loss >= -1e-9)
    named = case.modes and case.outcome in _OF_MODES
    rules = (
        (case.outcome in _NEVER and not named, case.outcome.sentence),
        (case.steps > case.budget, f"{case.steps} steps, {case.budget} allowed"),
        (done and unsound, "not finite, outside the walls, or energy from a contact"),
        (done and case.residual > OPEN, f"the ledger is open by {100.0 * case.residual:.0f} %"),
    )
    return next((f"system {case.number}, {case.fidelity}: {text}" for wrong, text in rules if wrong), "")


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


def _longest_duration(scene: Scene, first: float, second: float, closing: float) -> float:
    """Return the time [s] of _EVENTS crossings of the clearance, `first` then `second` [m], or vibrations on a wall.

    A lossy grain crosses the least clearance at the speed of the drive's acceleration there. One that keeps its speed
    gains it in the largest clearance and from the ceiling, and a closing ceiling drives it: speed times clearance is
    constant.
    """
    omega = 2.0 * math.pi * scene.frequency_hz
    natural = 2.0 * math.pi * scene.natural_frequency_hz
    amplitude = scene.excitation.largest_amplitude
    pace = scene.gravity + amplitude * max(min(omega, natural) ** 2, 0.1 * omega * natural)
    first, second = max(first, _LEAST_CLEARANCE), max(second, _LEAST_CLEARANCE)
    least = min(first, second)
    kept = 2.0 * closing + math.sqrt(2.0 * pace * max(first, second))
    elastic = restitution_of(contact_of(scene), kept, reduced_mass(system_of(scene))) > _ELASTIC
    if not elastic:
        crossing = _EVENTS * least / math.sqrt(0.5 * pace * least)
    elif second >= first or closing == 0.0:
        crossing = _EVENTS * least / kept
    else:
        crossing = _squeezed(kept * first, first, second, closing)
    fastest = max((math.sqrt(mode.stiffness / mode.mass) for mode in scene.further_modes), default=0.0)
    swings = 2.0 * math.pi * _SWINGS / fastest if fastest else math.inf
    return min(crossing, _vibration(scene, pace), swings)


def _squeezed(invariant: float, first: float, second: float, closing: float) -> float:
    """Return the duration [s] with _EVENTS crossings, speed times clearance being `invariant` [m^2/s] throughout."""

    def excess(log_duration: float) -> float:
        duration = math.exp(log_duration)
        moving = min((1.0 - _STILL) * duration, (first - second) / closing)
        last = first - moving * closing
        before, during = _STILL * duration / first**2, (1.0 / last - 1.0 / first) / closing
        return invariant * (before + during + ((1.0 - _STILL) * duration - moving) / last**2) - _EVENTS

    return math.exp(brentq(excess, -50.0, 50.0))


def _vibration(scene: Scene, pace: float) -> float:
    """Return the time [s] of _EVENTS vibrations of a grain pressed on a wall; infinite where its contact damps them."""
    contact, system = contact_of(scene), system_of(scene)
    if contact.law == IMPACT:
        return math.inf
    law, p = contact
    overlap = static_overlap(law, p, system.grain_mass * pace, 0.1)
    reduced = 1.0 / reduced_mass(system)
    model = ContactModel(
        law, HYSTERETIC[law], overlap, 1.0, system.stiffness, system.damping, system.gravity,
        1.0 / system.beam_mass, reduced, None,
    )  # fmt: skip
    fastest, natural = contact_pace(model, p, overlap, 0.0)
    duration = _EVENTS * 2.0 * math.pi / natural
    return duration if (fastest - natural) * duration < _FADED else math.inf
