# SPDX-License-Identifier: Apache-2.0
"""The arguments of the launch files: what is taken, and the one line for what is not. No `launch` needed."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from atpid_control.launching.arguments import (
    BENCH,
    REPLAY,
    STAND,
    LaunchArgumentError,
    check,
    check_names,
)

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "scenes" / "stand_realtime.yaml"
BAG = ROOT / "bags" / "thesis_4_3_short"
FILES = {"bench": BENCH, "stand": STAND, "replay": REPLAY}


def refusal(name: str, **given: str) -> str:
    """Return the line that refuses `given`, beside a scene and a bag that are there."""
    here = {"scene": str(SCENE), **({"bag": str(BAG)} if name == "replay" else {}), **given}
    with pytest.raises(LaunchArgumentError) as caught:
        check(f"{name}.launch.py", FILES[name], {key: text for key, text in here.items() if text is not None})
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "given", "line"),
    [
        ("stand", {"ni": "perhaps"}, "stand.launch.py: argument ni: given 'perhaps'; allowed: false or true"),
        ("stand", {"ni": "True"}, "given 'True'; allowed: false or true"),
        ("stand", {"labjack_config": "nothere.yaml"}, "argument labjack_config: {here}/nothere.yaml does not exist"),
        ("stand", {"ni_config": "nothere.yaml"}, "argument ni_config: {here}/nothere.yaml does not exist; give a file"),
        ("stand", {"motor_config": "."}, "argument motor_config: {here} is not a file; give a file"),
        ("stand", {"emulate_tty": "perhaps"}, "argument emulate_tty: given 'perhaps'; allowed: false or true"),
        ("bench", {"scene": None}, "bench.launch.py: argument scene is missing: scene file (docs/scenes.md)"),
        ("bench", {"scene": "nothere.yaml"}, "argument scene: {here}/nothere.yaml does not exist; give a file"),
        ("bench", {"scene": "/dev/null"}, "argument scene: /dev/null is not a file; give a file"),
        ("bench", {"scene": "~nosuchuser/a.yaml"}, "given '~nosuchuser/a.yaml'; there is no such user"),
        ("bench", {"map": "nothere.npz"}, "argument map: {here}/nothere.npz does not exist"),
        ("bench", {"bag": "there"}, "argument bag: {here}/there exists already, and a bag is never overwritten"),
        ("bench", {"bag": "dangling"}, "argument bag: {here}/dangling exists already"),
        ("bench", {"bag": "file/run"}, "{here}/file/run cannot be made: {here}/file is not a folder you may write to"),
        ("replay", {"rate": "abc"}, "argument rate: given 'abc'; allowed: a number from 0 to 1000"),
        ("replay", {"rate": "nan"}, "given 'nan'; allowed: a number from 0 to 1000"),
        ("replay", {"rate": "inf"}, "given 'inf'"),
        ("replay", {"rate": "-1"}, "given '-1'"),
        ("replay", {"rate": "1001"}, "given '1001'"),
        ("replay", {"bag": "nothere"}, "argument bag: {here}/nothere does not exist; give the folder of a bag"),
        ("replay", {"bag": "there"}, "{here}/there has no metadata.yaml, so it is not a bag"),
        ("replay", {"bag": "file"}, "{here}/file is not a bag; give the folder of a bag, or its .mcap file"),
        (
            "stand",
            {"live_port": "65536"},
            "argument live_port: given '65536'; allowed: 1 to 65535, or 0 for a free one",
        ),
        ("bench", {"live": "yes"}, "argument live: given 'yes'; allowed: false or true"),
        ("replay", {"record": "there"}, "argument record: {here}/there exists already"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    name: str, given: Any, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to("nothere")
    said = refusal(name, **given)
    assert line.format(here=tmp_path) in said
    assert len(said.splitlines()) == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read and write everything")
def test_what_may_not_be_read_or_written_is_refused(tmp_path: Path) -> None:
    secret, folder = tmp_path / "secret.yaml", tmp_path / "folder"
    secret.write_text("")
    secret.chmod(0)
    folder.mkdir(mode=0o500)
    assert f"{secret} cannot be read" in refusal("bench", scene=str(secret))
    assert f"{folder} is not a folder you may write to" in refusal("bench", bag=str(folder / "run"))


def test_paths_are_relative_to_the_current_folder_or_to_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "a.yaml").write_text("")
    for scene in ("a.yaml", "./a.yaml", "~/a.yaml", "../" + tmp_path.name + "/a.yaml"):
        values = check("bench.launch.py", FILES["bench"], {"scene": scene, "bag": "new/run"})
        assert values == {"scene": str(tmp_path / "a.yaml"), "bag": str(tmp_path / "new" / "run")}


def test_quotes_and_spaces_are_part_of_a_path(tmp_path: Path) -> None:
    odd = tmp_path / """it's "a" $(folder) with [spaces]: 1"""
    values = check("replay.launch.py", FILES["replay"], {"scene": str(SCENE), "bag": str(BAG), "record": str(odd)})
    assert values["record"] == str(odd)


@pytest.mark.parametrize(("given", "used"), [("0", "0.0"), ("1e2", "100.0"), (" 2.5 ", "2.5"), ("1000", "1000.0")])
def test_a_rate_is_passed_on_as_a_double(given: Any, used: str) -> None:
    values = check("replay.launch.py", FILES["replay"], {"scene": str(SCENE), "bag": str(BAG), "rate": given})
    assert values["rate"] == used


def test_a_bag_may_be_named_by_its_file() -> None:
    file = BAG / "bag_0.mcap"
    values = check("replay.launch.py", FILES["replay"], {"scene": str(SCENE), "bag": str(file)})
    assert values["bag"] == str(file)


def test_what_is_left_out_keeps_its_default() -> None:
    assert check("stand.launch.py", FILES["stand"], {"scene": str(SCENE), "map": "", "other": "x"}) == {
        "scene": str(SCENE)
    }


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("mpa", "bench.launch.py: unknown argument mpa; did you mean map?; allowed: scene, map, bag, motor_config"),
        ("sigterm_timeout", "unknown argument sigterm_timeout; allowed: scene"),
        ("record", "unknown argument record"),
    ],
)
def test_an_unknown_argument_is_refused(given: Any, line: str) -> None:
    with pytest.raises(LaunchArgumentError, match=re.escape(line)):
        check_names("bench.launch.py", FILES["bench"], ["scene", given])


def test_what_launch_itself_reads_is_known() -> None:
    check_names("bench.launch.py", FILES["bench"], ["scene", "emulate_tty", "ros_namespace", "launch-prefix"])


@pytest.mark.parametrize("name", FILES)
def test_each_argument_is_described_and_its_default_exists(name: str) -> None:
    assert len({argument.name for argument in FILES[name]}) == len(FILES[name])
    for argument in FILES[name]:
        assert argument.description
        if argument.file:
            assert (ROOT / "atpid_driver" / "config" / argument.file).is_file()
        elif argument.default:
            assert argument.check(argument.default) == argument.default


def test_the_checks_need_the_standard_library_only() -> None:
    """`ros2 launch` runs in the Python of the ROS installation, without the project's requirements."""
    sources = f"{ROOT / 'atpid_interfaces'}:{ROOT / 'atpid_control'}"
    done = subprocess.run(
        [sys.executable, "-S", "-c", "import atpid_control.launching.arguments"],
        env={"PYTHONPATH": sources, "LD_LIBRARY_PATH": os.environ.get("LD_LIBRARY_PATH", "")},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
