# SPDX-License-Identifier: Apache-2.0
"""The height map a run looks up: the scene's own, one that is there already, or one made now and kept."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from atpid_common.cache import cache_root
from atpid_common.errors import InputError
from atpid_common.share import share_folder
from atpid_sim.maps import HeightMap, MapError, build_map
from atpid_sim.maps.identity import identity_of
from atpid_sim.scene import ControlledCeiling, HarmonicExcitation, Scene

#: Amplitudes a map made here covers at least [m]; every scene of the thesis lies inside.
_USUAL = (0.002, 0.08)
_POINTS = 41


def map_for(scene: Scene, cache: Path | None = None) -> Path | None:
    """Return the map file for a scene that looks heights up; None for a scene that does not.

    The scene's own map is taken or refused (MapError); else the shipped ones and those in `cache` (default: the user's
    cache folder) are tried, and where none fits one is made there, with progress shown on standard error.
    """
    ceiling = scene.ceiling
    if not isinstance(ceiling, ControlledCeiling) or ceiling.controller != "lookup":
        return None
    if ceiling.map is not None:
        HeightMap.load(ceiling.map).check(scene)
        return ceiling.map
    folder = cache or user_cache()
    return next((path for path in _known(folder) if _fits(path, scene)), None) or _make(scene, folder)


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


def _known(cache: Path) -> Iterator[Path]:
    with suppress(InputError):  # used without a workspace
        yield from sorted((share_folder("atpid_control") / "config" / "maps").glob("*.npz"))
    yield from sorted(cache.glob("*.npz"))


def _fits(path: Path, scene: Scene) -> bool:
    """Whether the map was made for this system, mass fraction and amplitudes; a damaged one does not fit."""
    try:
        found = HeightMap.load(path)
        found.check(scene)
    except MapError:
        return False
    low, high = amplitudes_of(scene)
    return bool(found.amplitudes[0] <= low and high <= found.amplitudes[-1])


def _make(scene: Scene, folder: Path) -> Path:
    low, high = amplitudes_of(scene)
    amplitudes = np.linspace(min(_USUAL[0], 0.5 * low), max(_USUAL[1], 1.25 * high), _POINTS)
    purpose = [identity_of(scene), scene.grain.mass_fraction, amplitudes[[0, -1]].tolist(), scene.tolerance]
    key = hashlib.sha256(json.dumps(purpose, sort_keys=True).encode()).hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MapError(f"{folder}: no map can be kept there: {error.strerror}; name one in ceiling.map") from None
    path = folder / f"{key}.npz"
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    console.print(f"no height map fits this system: making one, kept as {path}", soft_wrap=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("height map", total=_POINTS)

        def report(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        build_map(scene, amplitudes.tolist(), [scene.grain.mass_fraction], path, report)
    return path
