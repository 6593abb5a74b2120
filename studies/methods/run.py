# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The comparison itself: every method and passive damper on every structure at every amplitude."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from atpid_control.selection.map_cache import map_for
from atpid_control.selection.protocol import Excitation, HeightSelector, SelectionError
from atpid_control.selection.registry import make_selector
from atpid_control.selection.search import SearchSelector
from atpid_sim.maps import DamperResponse
from atpid_sim.robust import with_beam
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.batch import HERE, Batch, Progress, Record, Workers
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.system import Array
from studies.methods.passive import RTOL, Fixed, Tuned, fixed_heights, remaining, tuned_masses
from studies.methods.structures import ComparisonError, Structure, description, levels, structures

#: What is compared, in the order of the tables.
PASSIVE = ("closed", "best fixed height, all amplitudes", "best fixed height, first amplitude",
           "Masri's gap, first amplitude", "tuned mass, Den Hartog", "tuned mass, optimised")  # fmt: skip
SELECTED = ("lookup", "pca", "direct", "direct, margin", "search")
#: Stiffness of the structure over that of the model, for structures that change by more than 5 % [-].
DETUNING = np.geomspace(0.25, 4.0, 33)
#: What stays as it was designed there.
HELD = ("lookup", "direct, margin")


class Answer(NamedTuple):
    """The answer of a method."""

    height: float  # [m], NaN: refused
    wall_s: float  # of the computation [s]
    structure_s: float  # in which the structure was watched, the ceiling moving [s]
    refusal: str  # empty: none


@dataclass(frozen=True)
class Compared:
    """The results for one scene; efficiencies are 1 - amplitude over that of the closed damper [-]."""

    name: str
    diameter: float  # of the grain [m]
    about: dict[str, float]  # frequency [Hz], mass fraction, damping ratio, restitution [-]
    amplitudes: tuple[float, ...]  # (n,) of the support [m]
    structures: tuple[str, ...]  # (s,) the first as modelled
    efficiencies: dict[str, Array]  # (s, n), NaN: refused
    seconds: dict[str, Array]  # (answers,) time to answer [s]; search: of the structure
    refusals: tuple[str, ...]  # sentences
    heights: dict[str, list[float]]  # for the structure as modelled (n,) [m]
    tuned: dict[str, dict[str, float]]  # tuned masses: frequency [Hz], damping [N s/m], efficiencies, stroke
    theory: dict[str, float]  # of Masri's gap: clearance over support amplitude, efficiency, multiplier
    detuned: dict[str, Array]  # (d,) efficiency at the first amplitude over `DETUNING`

    def nominal(self, what: str) -> Array:
        """Return the efficiencies (n,) on the structure as modelled."""
        return np.asarray(self.efficiencies[what][0])


def compare(
    scene: Scene, name: str, progress: Progress, workers: Workers = HERE, journal: Path | None = None
) -> Compared:
    """Return the comparison for one scene. Raises what a run, a map or a scene that does not fit raises.

    workers: for the simulations; the methods' answers are timed, so each is computed alone, here. journal: file of the
    answers, from which a comparison that was killed goes on; the caller removes it.
    """
    amplitudes, others = levels(scene), structures(scene)
    fixed, tuned = fixed_heights(scene, amplitudes), dict(zip(PASSIVE[4:], tuned_masses(scene), strict=True))
    selectors = _selectors(scene)
    places = list(product(SELECTED, range(len(others)), range(len(amplitudes))))
    asked = Batch(lambda at: _answer(at[0], selectors, others[at[1]], amplitudes[at[2]]), places)
    answers = dict(zip(places, asked.run(Workers(1), progress, _record(journal, scene)), strict=True))
    heights = {key: answer.height for key, answer in answers.items()}
    heights |= {
        (what, row, column): height
        for what, height in zip(PASSIVE[1:4], (fixed.whole_range, fixed.first, fixed.masri), strict=True)
        for row in range(len(others))
        for column in range(len(amplitudes))
    }
    answered = [(key[0], one) for key, one in answers.items() if not one.refusal]
    seconds = {
        what: np.array([one.wall_s + one.structure_s for name, one in answered if name == what]) for what in SELECTED
    }
    return Compared(
        name, 2.0 * scene.grain.radius, description(scene), amplitudes, tuple(one.name for one in others),
        _simulated(others, amplitudes, heights, workers) | _tuned_efficiencies(tuned, others, len(amplitudes)), seconds,
        tuple(dict.fromkeys(f"{what}: {_cause(one)}" for (what, *_), one in answers.items() if one.refusal)),
        {what: [heights[what, 0, k] for k in range(len(amplitudes))] for what in (*PASSIVE[1:4], *SELECTED)},
        {what: _about(one, scene) for what, one in tuned.items()}, _theory(fixed, scene),
        _detuned(scene, amplitudes[0], {what: heights[what, 0, 0] for what in HELD}, tuned, workers),
    )  # fmt: skip


def _record(journal: Path | None, scene: Scene) -> Record[tuple[str, int, int], Answer] | None:
    if journal is None:
        return None
    purpose = {"compare": 2, "scene": scene.to_mapping()}
    return Record(journal, purpose, tuple, Answer._asdict, lambda plain: Answer(**plain))


def _selectors(model: Scene) -> dict[str, HeightSelector | SelectionError]:
    """Return the selector of each method for the model, or why there is none.

    A margin has no deadline, as in lockstep: the heights that are compared depend on no other load of the machine.
    """
    closed = 2.0 * model.grain.radius
    looking = model.with_(ceiling={"closed": closed, "range": [closed, 1e3], "speed": 1.0, "controller": "lookup"})
    found: dict[str, HeightSelector | SelectionError] = {}
    for method in ("lookup", "pca", "direct"):
        try:
            found[method] = make_selector(method, model, map_for(looking) if method == "lookup" else None)
        except SelectionError as error:
            found[method] = error
    return found


def _answer(
    what: str, selectors: dict[str, HeightSelector | SelectionError], structure: Structure, amplitude: float
) -> Answer:
    """Return a method's answer. As in the loop it is given the amplitude [m] and frequency of the structure."""
    method, _, margin = what.partition(", ")
    try:
        selector = SearchSelector(structure.scene) if what == "search" else selectors[method]
        if isinstance(selector, SelectionError):
            raise selector
        frequency = math.nan if what == "search" else structure.scene.frequency_hz
        begun = time.perf_counter()
        chosen = selector.select(Excitation(amplitude, frequency=frequency), 1.0 if margin else 0.0)
    except SelectionError as error:
        return Answer(math.nan, math.nan, math.nan, str(error))
    return Answer(chosen.height, time.perf_counter() - begun, chosen.structure_s, "")


def _cause(answer: Answer) -> str:
    """Return a refusal without its last part, what to do instead."""
    return answer.refusal.rpartition("; ")[0] or answer.refusal


def _simulated(
    others: list[Structure],
    amplitudes: tuple[float, ...],
    heights: dict[tuple[str, int, int], float],
    workers: Workers,
) -> dict[str, Array]:
    """Return the efficiencies (s, n) at the heights {(what, structure, amplitude): height [m]}; closed: 0."""
    dampers = [DamperResponse(one.scene, RTOL) for one in others]
    found = {
        what: np.full((len(others), len(amplitudes)), math.nan) for what in dict.fromkeys(key[0] for key in heights)
    }
    jobs = list(dict.fromkeys((row, column, h) for (_, row, column), h in heights.items() if not math.isnan(h)))
    batch = Batch(lambda job: 1.0 - remaining(dampers[job[0]], amplitudes[job[1]], job[2]), jobs)
    done = dict(zip(jobs, batch.run(workers), strict=True))
    for (what, row, column), height in heights.items():
        found[what][row, column] = done.get((row, column, height), math.nan)
    return {"closed": np.zeros((len(others), len(amplitudes)))} | found


def _tuned_efficiencies(tuned: dict[str, Tuned], others: list[Structure], count: int) -> dict[str, Array]:
    return {
        what: np.array([[1.0 - one.remaining(other.scene)] * count for other in others]) for what, one in tuned.items()
    }


def _about(tuned: Tuned, scene: Scene) -> dict[str, float]:
    others = [with_beam(scene, stiffness=factor) for factor in (0.95, 1.05)]
    return asdict(tuned) | {
        "efficiency": 1.0 - tuned.remaining(scene),
        "efficiency_any_frequency": 1.0 - tuned.worst(scene),
        "efficiency_any_frequency_stiffness": 1.0 - max(tuned.worst(other) for other in others),
        "stroke": tuned.stroke(scene),
    }


def _theory(fixed: Fixed, scene: Scene) -> dict[str, float]:
    if fixed.theory is None:
        return {}
    promised = efficiency(fixed.theory.peak, DamperResponse(scene).closed_amplitude(1.0))
    return {"clearance": fixed.theory.clearance, "efficiency": promised, "multiplier": fixed.theory.multiplier}


def _detuned(
    scene: Scene, amplitude: float, heights: dict[str, float], tuned: dict[str, Tuned], workers: Workers
) -> dict[str, Array]:
    """Return efficiencies (d,) on structures of other stiffness, each at its resonance; nothing is designed anew."""
    others = [with_beam(scene, stiffness=float(factor)) for factor in DETUNING]

    def efficiency(job: tuple[int, float]) -> float:
        return 1.0 - remaining(DamperResponse(others[job[0]], RTOL), amplitude, job[1])

    heights_of = {height for height in heights.values() if not math.isnan(height)}
    jobs = [(k, height) for k in range(len(others)) for height in heights_of]
    found = dict(zip(jobs, Batch(efficiency, jobs).run(workers), strict=True))
    held = {w: np.array([found.get((k, h), math.nan) for k in range(len(others))]) for w, h in heights.items()}
    return held | {what: np.array([1.0 - one.remaining(other) for other in others]) for what, one in tuned.items()}


def steps(scene: Scene) -> int:
    """Return how many selections the comparison of a scene makes."""
    return len(SELECTED) * len(structures(scene)) * len(levels(scene))


def to_json(results: list[Compared]) -> list[dict[str, Any]]:
    """Return the results with arrays as lists and NaN as None."""
    return [_plain(asdict(one)) for one in results]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def load_scenes(paths: Sequence[Path]) -> dict[str, Scene]:
    """Return {name: scene} of the files. Raises SceneError, and ComparisonError where two have the same name."""
    names = [path.stem for path in paths]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ComparisonError(f"{twice}: given twice; allowed: files of different names")
    return {name: load_scene(path) for name, path in zip(names, paths, strict=True)}
