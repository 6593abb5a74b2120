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
from atpid_sim.display import counting, working
from atpid_sim.maps import DamperResponse, HeightMap, MapError, best_height, build_map, map_tolerance
from atpid_sim.maps.identity import identity_of
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import ControlledCeiling, HarmonicExcitation, Scene
from atpid_sim.scene.ceiling import CONTROLLERS

#: Amplitudes a map made here covers at least [m]; every scene of the thesis lies inside.
_USUAL = (0.002, 0.08)
_POINTS = 41
#: How closely the largest amplitude that can be simulated is looked for, as a factor.
_CLOSE = 1.1


def map_for(scene: Scene) -> Path | None:
    """Return the map file for a scene that looks heights up; for another method the one the scene names, if any.

    The scene's own map is taken or refused (MapError); else the shipped ones and those in the user's cache folder are
    tried, and where none fits one is made there, with progress shown on standard error.
    """
    ceiling = scene.ceiling
    if not isinstance(ceiling, ControlledCeiling):
        return None
    if ceiling.controller != "lookup":
        return ceiling.map if ceiling.controller == "learned" or ceiling.controller not in CONTROLLERS else None
    if ceiling.map is not None:
        HeightMap.load(ceiling.map).check(scene)
        return ceiling.map
    folder = user_cache()
    known = sorted(folder.glob("*.npz"))
    with suppress(InputError):  # used without a workspace
        known = sorted((share_folder("atpid_control") / "config" / "maps").glob("*.npz")) + known
    return next((path for path in known if _fits(path, scene)), None) or _make(scene, folder)


def user_cache() -> Path:
    """Return where maps made here are kept: $XDG_CACHE_HOME/atpid/maps, or ~/.cache/atpid/maps."""
    return cache_root() / "maps"


def amplitudes_of(scene: Scene) -> tuple[float, float]:
    """Return the smallest and largest steady excitation amplitude of the scene above zero [m]."""
    if not isinstance(scene.excitation, HarmonicExcitation):
        return _USUAL
    given = scene.excitation.amplitude
    values = [given] if isinstance(given, float) else [amplitude for _, amplitude in given]
    positive = [value for value in values if value > 0.0]
    return (min(positive), max(positive)) if positive else _USUAL


def _fits(path: Path, scene: Scene) -> bool:
    """Whether the map was made for this system, mass fraction and amplitudes; a damaged one does not fit."""
    if not _is_map_of(path, scene):
        return False
    found = HeightMap.load(path)
    return found.covers(*amplitudes_of(scene), scene.grain.mass_fraction)


def _make(scene: Scene, folder: Path) -> Path:
    low, high = amplitudes_of(scene)
    first, last = min(_USUAL[0], 0.5 * low), max(_USUAL[1], 1.25 * high)
    purpose = [identity_of(scene), scene.grain.mass_fraction, [first, last], scene.tolerance]
    key = hashlib.sha256(json.dumps(purpose, sort_keys=True).encode()).hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MapError(f"{folder}: no map can be kept there: {error.strerror}; name one in ceiling.map") from None
    path = folder / f"{key}.npz"
    if _is_map_of(path, scene):  # made before, and lacks amplitudes that cannot be computed: made anew it would again
        return path
    print(f"no height map fits this system: making one, kept as {path}", file=sys.stderr)
    with working("looking for the largest amplitude that can be simulated"):
        reached = _largest_computable(scene, 1.25 * high, last)
    if reached < last:
        print(f"amplitudes above {reached:.4g} m cannot be simulated: the map ends there", file=sys.stderr)
    # evenly spaced unless the smallest would lie within the first step
    spaced = np.linspace if reached <= _POINTS * first else np.geomspace
    amplitudes = [float(a) for a in spaced(first, reached, _POINTS)]
    with counting("height map", _POINTS) as count:
        made = build_map(scene, amplitudes, [scene.grain.mass_fraction], path, lambda done, _: count(done))
    if made.failures:
        first_lost = f"the first, {made.failures[0].amplitude:g} m: {made.failures[0].reason}"
        lost = f"{len(made.failures)} of its {_POINTS} points"
        print(f"{lost} could not be computed; {first_lost}", file=sys.stderr)
    return path


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
