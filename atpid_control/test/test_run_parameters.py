# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the nodes of a run start with: packages' files, the user's parameter file, and what the run sets itself."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from atpid_common.errors import InputError
from atpid_control.cli import main
from atpid_control.selection.map_cache import map_of_run
from atpid_control.stand import emulated
from atpid_control.stand.parameters import BenchError, Parameters, combined, read_parameters, write_parameters
from atpid_control.stand.parts import NAMES, PARTS, REAL_TIME_PARTS, parameters_for
from atpid_control.stand.running import RosOptions, commands_of
from atpid_sim.scene import Scene, load_scene

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "scenes" / "stand_realtime.yaml"
STANDARD = ROOT / "atpid_control/config/maps/standard.npz"


@pytest.fixture
def scene() -> Scene:
    return load_scene(FILE)


def read(folder: Path, text: str, namespace: str) -> Parameters:
    """Return what a parameter file of this text holds for the nodes in a namespace."""
    (folder / "values.yaml").write_text(text)
    return read_parameters(folder / "values.yaml", NAMES, namespace)


@pytest.mark.parametrize(
    ("namespace", "key"),
    [
        ("", "/**/selector_node"), ("", "/selector_node"), ("", "selector_node"), ("", "/**"), ("", "/*"),
        ("/lab1", "/**/selector_node"), ("/lab1", "/lab1/selector_node"), ("/lab1", "/*/selector_node"),
        ("/lab1", "/lab1/*"), ("/a/b", "/**/selector_node"), ("/a/b", "/a/**"),
    ],
)  # fmt: skip
def test_values_are_for_the_nodes_that_rcl_matches(namespace: str, key: str, tmp_path: Path) -> None:
    text = yaml.safe_dump({key: {"ros__parameters": {"margin": 2.0, "a": {"b": 1}}}})
    assert read(tmp_path, text, namespace)["selector_node"] == {"margin": 2.0, "a.b": 1}


def test_namespaces_may_be_blocks_and_later_values_hold(tmp_path: Path) -> None:
    text = "/**: {ros__parameters: {x: 1, y: 5e-05}}\nlab1: {selector_node: {ros__parameters: {x: 2}}}\n"
    found = read(tmp_path, text, "/lab1")
    assert found["selector_node"] == {"x": 2, "y": 5e-5}
    assert found["motor_node"] == {"x": 1, "y": 5e-5}


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("/**/selctor_node: {ros__parameters: {x: 1}}", r"/\*\*/selctor_node: .*\bselector_node"),
        ("/lab2/selector_node: {ros__parameters: {x: 1}}", r"/lab2/selector_node: .*/lab1"),
        ("selector_node: {ros__parameters: {x: 1}}", r"/selector_node: .*/\*\*/NODE"),
        ("/**/selector_node: {margin: 1.0}", r"/selector_node/margin: .* ros__parameters: NAME"),
        ("[1]", "no block"),
        ("a: b: c", "YAML"),
        ("/**/selector_node: {ros__parameters: {x: 1, x: 2}}", "twice"),
    ],
)
def test_a_file_with_values_for_no_node_is_refused_in_one_line(text: str, line: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=line) as caught:
        read(tmp_path, text, "/lab1")
    assert len(str(caught.value).splitlines()) == 1


def test_a_value_given_takes_the_place_of_the_usual_one_but_not_of_what_the_run_sets() -> None:
    usual: dict[str, dict[str, Any]] = {"a": {"x": 1, "y": 2, "z": 3}}
    assert combined(usual, {"a": {"z": 4}}, {"a": {"y": 5, "z": 4}, "b": {"x": 0}}) == {"a": {"x": 1, "y": 5, "z": 4}}
    with pytest.raises(BenchError, match=r"--params-file: z .*\ba: .* 5; .* 4: "):
        combined(usual, {"a": {"z": 4}}, {"a": {"z": 5}})


def test_the_users_values_reach_every_node_of_bench_and_emulated_stand(scene: Scene, tmp_path: Path) -> None:
    given = {name: {"own": name} for name in NAMES}
    places = (scene, FILE, STANDARD, tmp_path / "bag")
    bench, paced = (parameters_for(*places, lockstep=lockstep, given=given) for lockstep in (True, False))
    stand = emulated.parameters_emulated(*places, tmp_path, board=True, given=given)
    for found in (bench, paced, stand):
        assert {name: values["own"] for name, values in found.items()} == {name: name for name in found}
    assert bench.keys() == {part.name for part in PARTS}
    assert paced.keys() == {part.name for part in REAL_TIME_PARTS}
    assert set(NAMES) - set(stand) == {"live_node", "ni_node", "excitation_node"}
    assert stand["supervisor_node"]["nodes"][-2:] == ["labjack_node", "feed_node"]


def test_namespace_and_log_level_are_on_each_command_line(tmp_path: Path) -> None:
    for name, command in commands_of(tmp_path / "p.yaml", ros=RosOptions("/lab1", "warn")):
        words = ["--ros-args", "--enclave", f"/atpid/{name}", "--params-file", str(tmp_path / "p.yaml")]
        assert command[1:] == [*words, "-r", "__ns:=/lab1", "--log-level", "warn"]


def test_what_is_written_is_read_again_in_any_namespace(tmp_path: Path) -> None:
    values: Parameters = {"motor_node": {"speed": 5e-5, "list": ["a", ""], "on": True}, "selector_node": {"map": ""}}
    write_parameters(values, tmp_path / "p.yaml")
    assert read_parameters(tmp_path / "p.yaml", NAMES, "/a/b") == values


def test_the_map_is_the_one_given_else_one_that_fits_and_is_tried_first(scene: Scene, tmp_path: Path) -> None:
    assert map_of_run(scene, STANDARD) == STANDARD
    shipped = map_of_run(scene, None)
    assert shipped is not None
    assert shipped.read_bytes() == STANDARD.read_bytes()
    with pytest.raises(InputError, match=r"method: .*'guess'; .*lookup"):
        map_of_run(scene, None, "guess")


@pytest.mark.parametrize("command", ["stand", "bench"])
@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--map", "broken.npz"), r"--map: .*broken\.npz: .*NPZ"),
        (("--params-file", "values.yaml"), r"values\.yaml: .*\bmotor_node"),
        (("--params-file", "nothere.yaml"), r"nothere\.yaml: no such"),
        (("--params-file", "set.yaml"), r"--params-file: scene .*selector_node: .*'x\.yaml'"),
    ],
)
def test_a_run_is_refused_before_a_node_starts(
    command: str, words: tuple[str, ...], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.npz").write_text("no map")
    (tmp_path / "values.yaml").write_text("/**/mtor_node: {ros__parameters: {x: 1}}\n")
    (tmp_path / "set.yaml").write_text("/**/selector_node: {ros__parameters: {scene: x.yaml}}\n")
    assert main([command, str(FILE), *words]) == 2
    (error,) = [row for row in capfd.readouterr().err.splitlines() if row.startswith("error: ")]
    assert re.match("error: " + line, error), error


def test_a_stand_in_a_domain_that_does_not_exist_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "233")
    assert main(["stand", str(FILE)]) == 2
    assert re.fullmatch(r"error: ROS_DOMAIN_ID: .*'233'; .*\b0 .* 232\b.*\n", capsys.readouterr().err)
