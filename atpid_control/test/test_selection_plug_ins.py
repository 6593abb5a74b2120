# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Selectors of other distributions: found by their entry points, and refused in one line where they cannot be used."""

from collections.abc import Callable
from pathlib import Path

import pytest
import rclpy
from atpid_interfaces.srv import SelectHeight
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.parameter_tables import SELECTOR, selector_table
from atpid_control.nodes.selector_node import SelectorNode
from atpid_control.selection import METHODS, Excitation, SelectionError, make_selector, methods
from atpid_sim.scene import Scene, SceneError, load_scene

ROOT = Path(__file__).parents[2]
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
    """Return what installs a distribution with a module, and entry points NAME = MODULE:OBJECT."""
    monkeypatch.syspath_prepend(tmp_path)

    def installed(module: str, text: str, *entries: str) -> None:
        (tmp_path / f"{module}.py").write_text(text)
        info = tmp_path / f"{module}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("\n".join(["[atpid.selectors]", *entries, ""]))

    return installed


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(ROOT / "scenes" / "thesis_4_3.yaml")


def controlled_by(scene: Scene, method: str) -> Scene:
    ceiling = scene.model_dump(mode="json", exclude_none=True)["ceiling"] | {"controller": method}
    return scene.with_(ceiling=ceiling)


def test_an_installed_selector_is_a_method_like_the_others(install: Install, scene: Scene) -> None:
    install("plug_in_good", GOOD, "own = plug_in_good:Own")
    assert methods() == (*METHODS, "own")
    selector = make_selector("own", scene, Path("own.npz"))
    assert selector.select(Excitation(0.03)).height == 0.2
    assert vars(selector)["height_map"] == Path("own.npz")


def test_a_scene_and_the_node_take_an_installed_selector(install: Install, scene: Scene) -> None:
    allowed = "'lookup', 'pca', 'direct', 'search' or 'learned'"
    with pytest.raises(SceneError, match=f"controller: given 'own'; allowed: {allowed}"):
        controlled_by(scene, "own")
    install("plug_in_scene", GOOD, "own = plug_in_scene:Own")
    assert getattr(controlled_by(scene, "own").ceiling, "controller", "") == "own"
    (row,) = (row for row in selector_table() if row.name == "method")
    assert row.problem("own") == ""
    assert [row for row in SELECTOR if row.name == "method" and row.problem("own")]


def test_the_node_selects_by_its_parameter(install: Install) -> None:
    install("plug_in_node", GOOD, "own = plug_in_node:Own")
    given = {"scene": str(ROOT / "scenes" / "thesis_4_3.yaml"), "method": "own", "lockstep": True}
    rclpy.init()
    executor = TurnExecutor()
    nodes = (
        SelectorNode(parameter_overrides=[Parameter(name, value=value) for name, value in given.items()]),
        Node("ask"),
    )
    try:
        for node in nodes:
            executor.add_node(node)
        client = nodes[1].create_client(SelectHeight, "selector_node/select")
        assert client.wait_for_service(100.0)
        answer = client.call_async(SelectHeight.Request(amplitude=0.03))
        executor.spin_until_future_complete(answer, 100.0)
        assert (answer.result().method, answer.result().height) == ("own", 0.2)
    finally:
        nodes[0].close()
        for node in nodes:
            node.destroy_node()
        executor.shutdown()
        rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("text", "entry", "words"),
    [
        ("", "own = plug_in_{number}:Own", "cannot be loaded: AttributeError: "),
        ("import no_such_module_here", "own = plug_in_{number}:Own", "cannot be loaded: ModuleNotFoundError: "),
        ("raise ValueError('two\\nlines')", "own = plug_in_{number}:Own", "cannot be loaded: ValueError: two lines;"),
        ("def Own(): ...", "own = plug_in_{number}:Own", "cannot be made for this scene: TypeError: "),
        ("def Own(scene, height_map): ...", "own = plug_in_{number}:Own", "lacks method, simulates, select; needed: "),
        (GOOD, "another = plug_in_{number}:Own", "its method is 'own'; allowed: the entry point's name"),
    ],
    ids=range(6),
)
def test_a_selector_that_cannot_be_used_is_refused_in_one_line(
    install: Install, scene: Scene, request: pytest.FixtureRequest, text: str, entry: str, words: str
) -> None:
    number = request.node.callspec.id
    entry = entry.format(number=number)
    install(f"plug_in_{number}", text, entry)
    name = entry.partition(" ")[0]
    with pytest.raises(SelectionError) as caught:
        make_selector(name, scene)
    assert str(caught.value).startswith(f"selector {name} (plug_in_{number}:Own): {words}")
    assert "\n" not in str(caught.value)


def test_what_a_selector_itself_refuses_stays_its_own_error(install: Install, scene: Scene) -> None:
    text = "from atpid_control.selection import SelectionError\ndef Own(*_):\n    raise SelectionError('no such beam')"
    install("plug_in_refuses", text, "own = plug_in_refuses:Own")
    with pytest.raises(SelectionError, match=r"^no such beam$"):
        make_selector("own", scene)


def test_a_name_that_is_taken_is_refused(install: Install) -> None:
    install("plug_in_first", GOOD, "own = plug_in_first:Own")
    install("plug_in_second", GOOD, "own = plug_in_second:Own")
    with pytest.raises(SelectionError, match="plug_in_second:Own has a name that is taken by plug_in_first:Own"):
        methods()


def test_the_name_of_a_built_in_method_is_refused(install: Install) -> None:
    install("plug_in_lookup", GOOD, "lookup = plug_in_lookup:Own")
    with pytest.raises(SelectionError, match="plug_in_lookup:Own has a name that is taken by a built-in method"):
        methods()
