# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The height map of a run: the scene's own, one of the cache, or one made now and cached."""

import hashlib
import json
import math
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from atpid_common.errors import InputError
from atpid_common.folders import cache_root, share_folder
from atpid_control.selection.registry import make_selector
from atpid_sim.display import counting, working
from atpid_sim.maps import DamperResponse, HeightMap, MapError, best_height, build_map, map_tolerance
from atpid_sim.maps.identity import identity_of
from atpid_sim.maps.response import HIGHEST_RATIO, LOWEST_RATIO
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.scene.ceiling import CONTROLLERS
from atpid_sim.simulation.excitation import frequency_points

#: Amplitudes a map made here covers at least [m]; every scene of the thesis lies inside.
_USUAL = (0.002, 0.08)
_POINTS = 41
#: Amplitudes of a map over frequencies; distance of the latter over the natural one, and how far the map reaches beyond
#: those of the scene [-].
_POINTS_OF_RATIOS, _RATIO_STEP, _BESIDE = 15, 0.02, 0.01
#: How closely the largest amplitude that can be simulated is looked for, as a factor.
_CLOSE = 1.1


def map_for(scene: Scene) -> Path | None:
    """Return the map file for a scene that looks heights up; for another method the one the scene names, if any.

    The scene's own map is taken or refused (MapError); else the shipped ones and those in the user's cache folder are
    tried, and where none fits one is made there, with progress shown on standard error.
    """
    ceiling = scene.ceiling
    if not ceiling.controlled:
        return None
    if ceiling.controller != "lookup":
        return ceiling.map if ceiling.controller not in CONTROLLERS else None
    if ceiling.map is not None:
        HeightMap.load(ceiling.map).check(scene)
        return ceiling.map
    folder = cache_root() / "maps"
    known = sorted(folder.glob("*.npz"))
    with suppress(InputError):  # used without a workspace
        known = sorted((share_folder("atpid_control") / "config" / "maps").glob("*.npz")) + known
    return next((path for path in known if _fits(path, scene)), None) or _make(scene, folder)


def map_of_run(scene: Scene, given: Path | None, method: str = "") -> Path | None:
    """Return the map that a run's selector starts with: the one given (`--map`), else that of `map_for`.

    method: selects in place of the scene's controller; "": that does. Raises InputError where no selector can be made
    with it: here, before a node is started.
    """
    if not scene.ceiling.controlled:
        return given
    chosen = given or map_for(scene)
    try:
        make_selector(method or scene.ceiling.controller, scene, chosen)
    except InputError as error:
        raise MapError(f"--map: {error}") if given else error from None
    return chosen


def amplitudes_of(scene: Scene) -> tuple[float, float]:
    """Return the smallest and largest steady excitation amplitude of the scene above zero [m]."""
    if not scene.excitation.is_tone:
        return _USUAL
    positive = [amplitude for _, amplitude in scene.excitation.amplitude_points if amplitude > 0.0]
    return (min(positive), max(positive)) if positive else _USUAL


def _ratios_of(scene: Scene) -> tuple[float, float]:
    """Return the lowest and highest frequency of the scene's excitation over the natural one [-]."""
    ratios = [frequency / scene.natural_frequency_hz for _, frequency in frequency_points(scene)]
    return min(ratios), max(ratios)


def _fits(path: Path, scene: Scene) -> bool:
    """Whether the map was made for this system, mass fraction, amplitudes, frequencies; a damaged one does not fit."""
    if not _is_map_of(path, scene):
        return False
    found = HeightMap.load(path)
    return found.covers(*amplitudes_of(scene), scene.grain.mass_fraction, _ratios_of(scene))


def _make(scene: Scene, folder: Path) -> Path:
    low, high = amplitudes_of(scene)
    first, last = min(_USUAL[0], 0.5 * low), max(_USUAL[1], 1.25 * high)
    ratios = _ratios_to_map(scene)
    purpose: list[object] = [identity_of(scene), scene.grain.mass_fraction, [first, last], scene.tolerance]
    if ratios is not None:
        purpose.append(ratios)
    key = hashlib.sha256(json.dumps(purpose, sort_keys=True).encode()).hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MapError(f"{folder}: no map can be kept there: {error.strerror}; name one in ceiling.map") from None
    path = folder / f"{key}.npz"
    # made before, it lacks amplitudes that cannot be computed; made anew it would again
    if ratios is None and _is_map_of(path, scene):
        return path
    print(f"no height map fits this system: making one, kept as {path}", file=sys.stderr)
    with working("looking for the largest amplitude that can be simulated"):
        reached = _largest_computable(scene, 1.25 * high, last)
    if reached < last:
        print(
            f"amplitudes above {reached:.4g} {scene.driven_by.unit} cannot be simulated: the map ends there",
            file=sys.stderr,
        )
    # evenly spaced unless the smallest would lie within the first step
    spaced = np.linspace if reached <= _POINTS * first else np.geomspace
    amplitudes = [float(a) for a in spaced(first, reached, _POINTS if ratios is None else _POINTS_OF_RATIOS)]
    with counting("height map", len(amplitudes) * len(ratios or [1.0])) as count:
        fractions = [scene.grain.mass_fraction]
        made = build_map(scene, amplitudes, fractions, path, lambda done, _: count(done), frequency_ratios=ratios)
    if made.lost:
        print(made.lost, file=sys.stderr)
    return path


def _ratios_to_map(scene: Scene) -> list[float] | None:
    """Return the frequency ratios of a map for a scene whose frequency moves [-]; None: it does not."""
    if not scene.frequency_moves:
        return None
    low, high = _ratios_of(scene)
    first, last = max(low - _BESIDE, LOWEST_RATIO), min(high + _BESIDE, HIGHEST_RATIO)
    if not LOWEST_RATIO <= low < high <= HIGHEST_RATIO:
        raise MapError(
            f"excitation.frequency: given {low:.3g} to {high:.3g} of the natural one; a map reaches from "
            f"{LOWEST_RATIO:g} to {HIGHEST_RATIO:g}"
        )
    count = math.ceil((last - first) / _RATIO_STEP) + 1
    return [float(ratio) for ratio in np.round(np.linspace(first, last, count), 9)]


def _largest_computable(scene: Scene, needed: float, highest: float) -> float:
    """Return about the largest support amplitude [m] up to `highest` with a best height, at least `needed`."""
    damper = DamperResponse(scene, map_tolerance(scene))
    if highest <= needed or _computable(damper, highest):
        return highest
    low, high = needed, highest
    while high > _CLOSE * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if _computable(damper, middle) else (low, middle)
    return low


def _computable(damper: DamperResponse, amplitude: float) -> bool:
    try:
        best_height(damper, amplitude)
    except NumericalFailure:
        return False
    return True


def _is_map_of(path: Path, scene: Scene) -> bool:
    try:
        HeightMap.load(path).check(scene)
    except MapError:
        return False
    return True
