# SPDX-License-Identifier: Apache-2.0
"""Methods by name: those a scene may name (atpid_sim/scene/ceiling.py), and `fixed` for a ceiling of the scene's own.

A new method is one file, one entry here and its name there (docs/selection.md).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from atpid_control.selection.protocol import HeightSelector, SelectionError
from atpid_sim.scene import Scene

Factory = Callable[[Scene, Path | None], HeightSelector]


def _lookup(scene: Scene, height_map: Path | None) -> HeightSelector:
    from atpid_control.selection.lookup import LookupSelector
    from atpid_sim.maps import HeightMap

    if height_map is None:
        raise SelectionError(
            "method lookup: no map given; make one with `python -m atpid_sim map SCENE.yaml ...` and name it"
        )
    return LookupSelector(scene, HeightMap.load(height_map))


def _fixed(scene: Scene, height_map: Path | None) -> HeightSelector:
    from atpid_control.selection.fixed import FixedSelector

    del height_map
    return FixedSelector(scene.ceiling.heights[-1][1])


def _pca(scene: Scene, height_map: Path | None) -> HeightSelector:
    from atpid_control.selection.pca import PcaSelector

    del height_map
    return PcaSelector(scene)


def _direct(scene: Scene, height_map: Path | None) -> HeightSelector:
    from atpid_control.selection.direct import DirectSelector

    del height_map
    return DirectSelector(scene)


def _search(scene: Scene, height_map: Path | None) -> HeightSelector:
    from atpid_control.selection.search import SearchSelector

    del height_map
    return SearchSelector(scene)


METHODS: dict[str, Factory] = {
    "lookup": _lookup,
    "pca": _pca,
    "direct": _direct,
    "search": _search,
    "fixed": _fixed,
}


def make_selector(method: str, scene: Scene, height_map: Path | None = None) -> HeightSelector:
    """Return the selector called `method` for `scene`; raise SelectionError or MapError where it cannot be."""
    if method not in METHODS:
        raise SelectionError(f"method: given {method!r}; allowed: {', '.join(METHODS)}")
    return METHODS[method](scene, height_map)
