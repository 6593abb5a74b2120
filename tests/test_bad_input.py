# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bad input to the bench and the nodes: one clear line, status 2, nothing started and nothing overwritten."""

import subprocess
from pathlib import Path
from typing import Any, NoReturn

import pytest
import yaml
from graph_runs import parameters

from atpid_control.cli import main
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.errors import PlantFailedError
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import PARTS
from atpid_control.stand.running import run_lockstep
from atpid_sim.maps import HeightMap
from atpid_sim.scene import load_scene


def edited(scenes: Path, tmp_path: Path, **changes: Any) -> Path:
    """Write thesis 4.3 with some keys replaced, without checking them."""
    mapping = yaml.safe_load((scenes / "thesis_4_3.yaml").read_text().replace("2.1e8", "210000000.0"))
    mapping["tolerance"], mapping["sensors"]["laser"]["noise"] = 1e-6, 20e-6
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(mapping | changes))
    return path


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Return the one line a command is refused with."""
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gravitty": 9.81}, ["scene.yaml", "gravitty", "did you mean gravity"]),
        ({"ceiling": {"height": 0.01}}, ["ceiling.height", "0.01", "0.017"]),
        (
            {"ceiling": {"closed": 0.017, "range": [0.017, 1.0], "speed": -1.0, "controller": "lookup"}},
            ["ceiling.speed"],
        ),
        ({"duration": float("nan")}, ["duration"]),
    ],
)
def test_a_scene_that_cannot_be(
    scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: Any, words: str
) -> None:
    line = refused(capsys, "bench", edited(scenes, tmp_path, **changes), "--out", tmp_path / "out")
    assert all(word in line for word in words), line
    assert not (tmp_path / "out").exists()


def test_a_scene_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no such file" in refused(capsys, "bench", tmp_path / "none.yaml", "--out", tmp_path / "out")


@pytest.fixture
def other_map(scenes: Path, tmp_path: Path) -> Path:
    """A map made for a stiffer beam."""
    source = map_for(load_scene(scenes / "thesis_4_3.yaml"))
    assert source is not None
    changed = HeightMap.load(source)
    identity = yaml.safe_load(yaml.safe_dump(changed.identity))
    key = next(key for key in identity if "stiff" in key)
    identity[key] *= 2.0
    object.__setattr__(changed, "identity", identity)
    changed.save(tmp_path / "other.npz")
    return tmp_path / "other.npz"


def test_a_map_for_another_beam(
    scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], other_map: Path
) -> None:
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup", "map": str(other_map)}
    line = refused(capsys, "bench", edited(scenes, tmp_path, ceiling=ceiling), "--out", tmp_path / "out")
    assert "other.npz: made for" in line
    assert not (tmp_path / "out").exists()


def test_a_map_that_is_a_text_file(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "map.npz").write_text("hello")
    ceiling = {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup", "map": "map.npz"}
    line = refused(capsys, "bench", edited(scenes, tmp_path, ceiling=ceiling), "--out", tmp_path / "out")
    assert "is no NPZ archive of arrays" in line


def test_a_folder_with_something_else_in_it(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("mine")
    line = refused(capsys, "bench", scenes / "thesis_4_3.yaml", "--out", tmp_path / "out")
    assert "not the bench's (thesis.tex)" in line
    assert (tmp_path / "out" / "thesis.tex").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("node", "changes", "words"),
    [
        ("plant_node", {"scene": "none.yaml"}, "no such file"),
        ("plant_node", {"scene": ""}, "parameter scene of plant_node is not set"),
        ("plant_node", {"scene": 3}, "expecting type 'STRING'"),
        ("selector_node", {"method": "guess"}, "parameter method of selector_node: given 'guess'; allowed: "),
        ("selector_node", {"dead_band": -1.0}, "parameter dead_band of selector_node: given -1; allowed: 0 to 0.9"),
        ("selector_node", {"map": "none.npz"}, "no such file"),
    ],
)
def test_a_node_with_a_bad_parameter(scenes: Path, tmp_path: Path, node: str, changes: Any, words: str) -> None:
    _, given = parameters(scenes / "thesis_4_3.yaml", tmp_path, lockstep=False)
    given[node] |= changes
    write_parameters(given, tmp_path / "parameters.yaml")
    part = next(part for part in PARTS if part.name == node)
    command = [str(part.executable), "--ros-args", "--params-file", str(tmp_path / "parameters.yaml")]
    with own_domain():
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    lines = ended.stderr.strip().splitlines()
    assert len(lines) == 1, lines
    assert words in lines[0]


@pytest.mark.slow
def test_a_parameter_file_that_is_not_there(tmp_path: Path) -> None:
    part = next(part for part in PARTS if part.name == "plant_node")
    command = [str(part.executable), "--ros-args", "--params-file", str(tmp_path / "none.yaml")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "none.yaml" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_plant_that_fails_is_status_3_and_one_line(
    scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> NoReturn:
        raise PlantFailedError("the plant stopped at 1 s: the grain left the container")

    monkeypatch.setattr("atpid_control.commands.bench.run_lockstep", fails)
    assert main(["bench", str(scenes / "thesis_4_3.yaml"), "--out", str(tmp_path)]) == 3
    assert capsys.readouterr().err == "error: the plant stopped at 1 s: the grain left the container\n"


def test_a_recorder_that_cannot_write_stops_the_run(scenes: Path, tmp_path: Path) -> None:
    _, given = parameters(scenes / "thesis_4_3.yaml", tmp_path, lockstep=True)
    given["recorder_node"]["bag"] = "/dev/full/bag"
    with own_domain(), pytest.raises(ValueError, match="/dev/full"):
        run_lockstep(given, lambda _: None)
