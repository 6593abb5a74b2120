# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bad input to the bench and the nodes: one clear line, status 2, nothing started and nothing overwritten."""

import dataclasses
import re
import subprocess
from pathlib import Path
from typing import Any, NoReturn

import pytest
import yaml
from graph_runs import parameters

from atpid_control.cli import main
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes.composition import run_lockstep
from atpid_control.stand.parameters import PlantFailedError, write_parameters
from atpid_control.stand.parts import PARTS
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene

CEILING = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"}


@pytest.fixture
def scene(scenes: Path) -> Path:
    return scenes / "thesis_4_3.yaml"


def refused(capsys: pytest.CaptureFixture[str], scene: Path, out: Path) -> str:
    """Return the one line with which the bench refuses a scene."""
    assert main(["bench", str(scene), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"gravitty": 9.81}, r"scene\.yaml.*gravitty.*\bgravity\b"),
        ({"ceiling": {"height": 0.01}}, r"ceiling\.height.*0\.01\b.*0\.017"),
        ({"duration": float("nan")}, r"duration.*nan"),
        ({"ceiling": CEILING | {"map": "other.npz"}}, r"other\.npz: "),
        ({"ceiling": CEILING | {"map": "text.npz"}}, r"text\.npz.*\bNPZ\b"),
    ],
)
def test_a_bad_scene(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: Any, parts: str) -> None:
    (tmp_path / "text.npz").write_text("hello")
    source = map_for(load_scene(scene))
    assert source is not None
    stored = HeightMap.load(source)
    stiffness = next(key for key in stored.identity if "stiff" in key)
    identity = {**stored.identity, stiffness: 2.0 * stored.identity[stiffness]}
    dataclasses.replace(stored, identity=identity).save(tmp_path / "other.npz")
    mapping = yaml.safe_load(scene.read_text().replace("2.1e8", "210000000.0"))
    mapping["tolerance"], mapping["sensors"]["laser"]["noise"] = 1e-6, 20e-6
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(mapping | changes))
    assert re.search(parts, refused(capsys, tmp_path / "scene.yaml", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_scene_that_is_not_there_or_a_folder_with_something_else_in_it(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "none.yaml" in refused(capsys, tmp_path / "none.yaml", tmp_path / "out")
    (tmp_path / "thesis.tex").write_text("mine")
    assert "thesis.tex" in refused(capsys, scene, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    assert (tmp_path / "thesis.tex").read_text() == "mine"


@pytest.mark.parametrize(
    ("node", "changes", "parts"),
    [
        ("plant_node", {"scene": "none.yaml"}, r"none\.yaml"),
        ("plant_node", {"scene": 3}, r"\bscene\b.*plant_node.*3.*text"),
        ("selector_node", {"method": "guess"}, r"method.*selector_node.*guess.*\blookup\b"),
        ("selector_node", {"dead_band": -1.0}, r"dead_band.*selector_node.*-1\b.*\b0\b.*0\.9"),
        ("selector_node", {"map": "none.npz"}, r"none\.npz"),
    ],
)
def test_a_bad_node_parameter(scene: Path, tmp_path: Path, node: str, changes: dict[str, object], parts: str) -> None:
    _, given = parameters(scene, tmp_path, lockstep=False)
    given[node] |= changes
    write_parameters(given, tmp_path / "parameters.yaml")
    part = next(part for part in PARTS if part.name == node)
    command = [str(part.executable), "--ros-args", "--params-file", str(tmp_path / "parameters.yaml")]
    with own_domain():
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert re.search(parts, line)


def test_a_plant_that_fails_is_status_3_and_one_line(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> NoReturn:
        raise PlantFailedError("stopped at 1 s")

    monkeypatch.setattr("atpid_control.stand.nodes.composition.run_lockstep", fails)
    assert main(["bench", str(scene), "--out", str(tmp_path)]) == 3
    assert capsys.readouterr().err == "error: stopped at 1 s\n"


def test_a_recorder_that_cannot_write_stops_the_run(scene: Path, tmp_path: Path) -> None:
    _, given = parameters(scene, tmp_path, lockstep=True)
    given["recorder_node"]["bag"] = "/dev/full/bag"
    with own_domain(), pytest.raises(ValueError, match="/dev/full"):
        run_lockstep(given, lambda _: None)
