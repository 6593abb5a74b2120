# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One contract for every selector: what it gives, what it refuses, and that it says so in one line."""

import math
from pathlib import Path
from typing import Any

import pytest

from atpid_control.selection import METHODS, Excitation, HeightSelector, Selection, SelectionError, make_selector
from atpid_control.selection.protocol import violations
from atpid_sim.scene import Scene, load_scene
from atpid_sim.scene.ceiling import CONTROLLERS

ROOT = Path(__file__).parents[2]
MAP = ROOT / "atpid_control" / "config" / "maps" / "standard.npz"
COMPUTING = ("pca", "direct", "search")
SELECTING = ("lookup", "learned", *COMPUTING)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "thesis_4_3.yaml")


@pytest.fixture(scope="module")
def selectors(scene: Scene) -> dict[str, HeightSelector]:
    return {method: make_selector(method, scene, MAP if method == "lookup" else None) for method in SELECTING}


def test_every_method_is_in_the_registry() -> None:
    assert set(METHODS) == {*SELECTING, "fixed"}


@pytest.mark.parametrize("method", SELECTING)
@pytest.mark.parametrize(("amplitude", "height"), [(0.015, 0.29), (0.04, 0.76), (0.03, 0.57)])
def test_every_method_finds_the_thesis_heights(
    selectors: dict[str, HeightSelector], method: str, amplitude: float, height: float
) -> None:
    chosen = selectors[method].select(Excitation(amplitude))
    assert chosen.method == selectors[method].method == method
    assert chosen.height == pytest.approx(height, rel=0.06)
    assert 1.0 - chosen.efficiency < 0.21
    assert chosen.price == 0.0


@pytest.mark.parametrize("method", SELECTING)
def test_a_margin_never_raises_the_ceiling(selectors: dict[str, HeightSelector], method: str) -> None:
    bare = selectors[method].select(Excitation(0.03))
    if method == "search":  # it watches the damper itself; there is nothing to be safe from
        return
    assert selectors[method].select(Excitation(0.03, 0.001), margin=2.0).height < bare.height


@pytest.mark.parametrize(
    ("values", "named"),
    [
        *(((amplitude,), "amplitude: given") for amplitude in (math.nan, math.inf, 0.0, -0.01)),
        *(((0.03, std), "amplitude_std: given") for std in (math.nan, math.inf, -1.0)),
        *(((0.03, 0.0, frequency), "frequency: given") for frequency in (math.inf, 0.0, -5.0)),
    ],
)
def test_an_impossible_excitation_is_refused(values: tuple[float, ...], named: str) -> None:
    with pytest.raises(SelectionError, match=named) as caught:
        Excitation(*values)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", SELECTING)
@pytest.mark.parametrize("margin", [-1.0, math.nan, math.inf])
def test_an_impossible_margin_is_refused(selectors: dict[str, HeightSelector], method: str, margin: float) -> None:
    with pytest.raises(SelectionError, match="margin"):
        selectors[method].select(Excitation(0.03), margin)


@pytest.mark.parametrize("method", ["pca", "direct"])
def test_selecting_twice_gives_the_same(selectors: dict[str, HeightSelector], method: str) -> None:
    first, second = (selectors[method].select(Excitation(0.02)) for _ in range(2))
    assert (first.height, first.beam_amplitude) == (second.height, second.beam_amplitude)


def test_unknown_methods_are_named(scene: Scene) -> None:
    with pytest.raises(SelectionError, match="given 'guess'; allowed: lookup, pca, direct, search, learned, fixed"):
        make_selector("guess", scene)


def test_a_selection_is_plain_data() -> None:
    chosen = Selection(0.3, 0.07, 0.8, "lookup")
    assert (chosen.evaluations, chosen.wall_s, chosen.price, chosen.stages) == (0, 0.0, 0.0, ())


def test_the_methods_a_scene_may_name_are_those_there_are() -> None:
    assert set(METHODS) == {*CONTROLLERS, "fixed"}


@pytest.mark.parametrize("method", SELECTING)
def test_every_method_keeps_the_contract(selectors: dict[str, HeightSelector], scene: Scene, method: str) -> None:
    assert violations(selectors[method], 0.03, 2.0 * scene.grain.radius) == []


class Careless:
    """A selector that keeps to nothing."""

    method, simulates = "", 1

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        del excitation, height
        return Selection(-0.1 + margin, -1.0, 2.0, "other")


def test_the_contract_names_each_violation() -> None:
    careless: Any = Careless()
    assert len(violations(careless, 0.03, 0.017)) == 6
