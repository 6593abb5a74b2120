# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Methods of selection by name: those of this package, and selectors of other distributions by entry point.

A scene names the built-in ones (atpid_sim/scene/ceiling.py) or a plug-in; `fixed` is for a ceiling no controller moves.
"""

from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

from atpid_common.entry_points import SELECTORS, installed, loaded
from atpid_common.errors import AtpidError, one_line
from atpid_control.selection.protocol import HeightSelector, Options, SelectionError
from atpid_sim.scene import Scene

#: Makes a selector for a scene, with the height map given (None: none) and the options of the method.
_Factory = Callable[[Scene, Path | None, Options], HeightSelector]
_USUAL = Options()


# What a method needs is loaded with it: maps load the simulation, which other nodes do without.
def _fixed(scene: Scene, _height_map: Path | None, _options: Options) -> HeightSelector:
    from atpid_control.selection.lookup import FixedSelector

    return FixedSelector(scene.ceiling.heights[-1][1])


def _lookup(scene: Scene, height_map: Path | None, _options: Options) -> HeightSelector:
    from atpid_control.selection.lookup import LookupSelector
    from atpid_sim.maps import HeightMap

    if height_map is None:
        raise SelectionError(
            "method lookup: no map given; make one with `atpid map SCENE.yaml ...` and name it: "
            "--map FILE, map:=FILE, or `map` of the scene's ceiling"
        )
    return LookupSelector(scene, HeightMap.load(height_map))


def _pca(scene: Scene, _height_map: Path | None, options: Options) -> HeightSelector:
    from atpid_control.selection.pca import PcaSelector

    model = scene if options.gravity else scene.with_(gravity=0.0)
    return _at_any_frequency(PcaSelector(scene, gravity=options.gravity), model)


def _direct(scene: Scene, _height_map: Path | None, options: Options) -> HeightSelector:
    from atpid_control.selection.direct import DirectSelector
    from atpid_control.selection.margin import MarginBox

    box = MarginBox(stiffness=options.stiffness_uncertainty)
    return _at_any_frequency(DirectSelector(scene, box, deadline=options.deadline), scene)


def _search(scene: Scene, _height_map: Path | None, _options: Options) -> HeightSelector:
    from atpid_control.selection.search import SearchSelector

    return _at_any_frequency(SearchSelector(scene), scene)


def _at_any_frequency(selector: HeightSelector, scene: Scene) -> HeightSelector:
    """Return a method that simulates as one that stays closed where the damper is of no use, at any frequency."""
    from atpid_control.selection.checks import AnyFrequency

    return AnyFrequency(selector, scene)


METHODS: dict[str, _Factory] = {"lookup": _lookup, "pca": _pca, "direct": _direct, "search": _search, "fixed": _fixed}


def plug_ins() -> dict[str, EntryPoint]:
    """Return the installed entry points of the group `atpid.selectors` by name.

    Raises SelectionError for a name that is taken: by a built-in method, or by another distribution.
    """
    return installed(SELECTORS, METHODS, SelectionError)


def methods() -> tuple[str, ...]:
    """Return the names of all methods, built-in ones first. Raises SelectionError as `plug_ins` does."""
    return (*METHODS, *plug_ins())


def make_selector(
    method: str, scene: Scene, height_map: Path | None = None, options: Options = _USUAL
) -> HeightSelector:
    """Return the selector called `method` for `scene`: the one way, of commands, nodes and Python alike.

    options: those that the method does not take are left out (`TAKES`). Raises SelectionError or MapError where the
    selector cannot be made.
    """
    if method in METHODS:
        return METHODS[method](scene, height_map, options)
    added = plug_ins()
    if method not in added:
        raise SelectionError(f"method: given {method!r}; allowed: {', '.join((*METHODS, *added))}")
    return _plugged_in(added[method], scene, height_map)


def _plugged_in(point: EntryPoint, scene: Scene, height_map: Path | None) -> HeightSelector:
    """Return the selector of another distribution; whatever is wrong with it is one line."""
    factory = loaded(point, error=SelectionError)
    what = f"selector {point.name} ({point.value})"
    try:
        selector: HeightSelector = factory(scene, height_map)
    except AtpidError:
        raise
    except Exception as error:
        reason = one_line(f"{type(error).__name__}: {error}")
        raise SelectionError(f"{what}: cannot be made for this scene: {reason}") from error
    missing = [name for name in ("method", "simulates", "select") if not hasattr(selector, name)]
    if missing:
        raise SelectionError(f"{what}: lacks {', '.join(missing)}; needed: what HeightSelector has")
    if selector.method != point.name:
        raise SelectionError(f"{what}: its method is {selector.method!r}; allowed: the entry point's name")
    return selector
