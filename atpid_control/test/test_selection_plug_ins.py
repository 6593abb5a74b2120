# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selectors of other distributions: found by their entry points, and refused in one line where they cannot be used."""

from collections.abc import Callable
from pathlib import Path

import pytest

from atpid_common.entry_points import SELECTORS
from atpid_common.testing import install as install_distribution
from atpid_control.nodes.parameter_tables import SELECTOR, selector_table
from atpid_control.selection import Excitation, SelectionError, make_selector
from atpid_control.selection.registry import METHODS, methods
from atpid_sim.scene import Scene, SceneError, load_scene

FILE = Path(__file__).parents[2] / "scenes" / "thesis_4_3.yaml"
SCENE = load_scene(FILE)
GOOD = """
from atpid_control.selection.lookup import FixedSelector

class Own(FixedSelector):
    method = "own"

    def __init__(self, scene, height_map):
        super().__init__(0.2)
        self.height_map = height_map
"""

Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Return what installs a distribution with a module, and the entry point NAME = MODULE:Own."""

    def installed(module: str, text: str = GOOD, name: str = "own") -> None:
        install_distribution(tmp_path, monkeypatch, f"[{SELECTORS}]\n{name} = {module}:Own\n", **{module: text})

    return installed


def controlled_by(method: str) -> Scene:
    ceiling = SCENE.model_dump(mode="json", exclude_none=True)["ceiling"] | {"controller": method}
    return SCENE.with_(ceiling=ceiling)


def test_an_installed_selector_is_a_method_like_the_others(install: Install) -> None:
    with pytest.raises(SceneError, match=r"controller: .*'own'; .*'lookup', 'pca', 'direct' or 'search'"):
        controlled_by("own")
    install("plug_in_good")
    assert methods() == (*METHODS, "own")
    selector = make_selector("own", SCENE, Path("own.npz"))
    assert selector.select(Excitation(0.03)).height == 0.2
    assert vars(selector)["height_map"] == Path("own.npz")
    assert getattr(controlled_by("own").ceiling, "controller", "") == "own"
    (row,) = (row for row in selector_table() if row.name == "method")
    assert row.problem("own") == ""
    assert [row for row in SELECTOR if row.name == "method" and row.problem("own")]


@pytest.mark.parametrize(
    ("module", "text", "name", "words"),
    [
        ("importing", "import no_such_module_here", "own", ["ModuleNotFoundError"]),
        ("unmade", "def Own(): ...", "own", ["TypeError"]),
        ("nothing", "def Own(scene, height_map): ...", "own", ["method", "simulates", "select"]),
        ("renamed", GOOD, "another", ["'own'"]),
    ],
)
def test_a_selector_that_cannot_be_used_is_refused_in_one_line(
    install: Install, module: str, text: str, name: str, words: list[str]
) -> None:
    install(f"plug_in_{module}", text, name)
    with pytest.raises(SelectionError) as caught:
        make_selector(name, SCENE)
    line = str(caught.value)
    assert f"{name} (plug_in_{module}:Own" in line
    assert [word for word in words if word not in line] == []
    assert "\n" not in line


def test_what_a_selector_itself_refuses_stays_its_own_error(install: Install) -> None:
    text = "from atpid_control.selection import SelectionError\ndef Own(*_):\n    raise SelectionError('beamless')"
    install("plug_in_refuses", text)
    with pytest.raises(SelectionError, match=r"^beamless$"):
        make_selector("own", SCENE)


def test_a_name_that_is_taken_is_refused(install: Install) -> None:
    install("plug_in_lookup", name="lookup")
    with pytest.raises(SelectionError, match=r"plug_in_lookup:Own .* built in"):
        methods()
