# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The arguments of the launch files: those of the commands, and the words they become. No `launch` needed."""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import pytest

from atpid_control.cli import COMMANDS as GROUPS
from atpid_control.stand.launching.arguments import (
    LaunchArgumentError,
    arguments_of,
    check_names,
    is_asked_for,
    words_of,
)
from atpid_control.stand.launching.options import OPTIONS, namespace

COMMANDS = {name: place for group in GROUPS.values() for name, (place, _) in group.items()}
ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "atpid_control" / "launch").glob("*.launch.py"))


def parser_of(command: str) -> argparse.ArgumentParser:
    """Return the parser of the command itself."""
    parser = argparse.ArgumentParser()
    __import__(COMMANDS[command], fromlist=["add_arguments"]).add_arguments(parser)
    return parser


def test_each_launch_file_starts_the_command_of_its_name() -> None:
    assert [file.name for file in FILES] == [f"{command}.launch.py" for command in sorted(OPTIONS)]
    assert set(OPTIONS) <= set(COMMANDS)
    for file in FILES:
        assert f"atpid {file.name.partition('.')[0]}`" in file.read_text()


@pytest.mark.parametrize("command", OPTIONS)
def test_the_arguments_are_the_options_of_the_command(command: str) -> None:
    options = {action.dest: action for action in parser_of(command)._actions if action.dest != "help"}
    always = {"bench": {"real_time"}}.get(command, set())
    arguments = {argument.name: argument for argument in arguments_of(command)}
    assert list(arguments) == [name for name in options if name not in always]
    for name, argument in arguments.items():
        action = options[name]
        assert argument.description
        assert "%" not in argument.description
        assert (argument.default is None) == (not action.option_strings), name
        assert argument.choices == tuple(action.choices or ())


@pytest.mark.parametrize("command", OPTIONS)
def test_what_is_left_out_keeps_the_default_of_the_command(command: str) -> None:
    defaults = {argument.name: argument.default or "" for argument in arguments_of(command)}
    (operand,) = [argument.name for argument in arguments_of(command) if argument.default is None]
    usual = vars(parser_of(command).parse_args(["x"]))
    words = words_of(command, {**defaults, operand: "x"})
    assert vars(parser_of(command).parse_args(words[1:])) == usual | ({"real_time": True} if command == "bench" else {})


def test_each_argument_reaches_the_command() -> None:
    given = {
        "scene": "a scene.yaml", "map": "~/map.npz", "bag": "-odd", "ni": "True", "labjack_config": "l.yaml",
        "params_file": "p.yaml", "namespace": "lab1", "log_level": "warn", "restarts": "2", "move": "0.1",
        "live": "yes", "live_port": "9000",
    }  # fmt: skip
    args = parser_of("stand").parse_args(words_of("stand", given)[1:])
    assert (args.scene, args.map, args.bag) == (Path("a scene.yaml"), Path("~/map.npz").expanduser(), Path("-odd"))
    assert (args.ni, args.live, args.live_port) == (True, True, 9000)
    assert (args.labjack_config, args.params_file) == (Path("l.yaml"), Path("p.yaml"))
    assert (args.namespace, args.log_level, args.restarts, args.move) == ("/lab1", "warn", 2, 0.1)


@pytest.mark.parametrize("yes", ["true", "True", "TRUE", "1", "yes", "on"])
@pytest.mark.parametrize("no", ["false", "False", "0", "no", "off", ""])
def test_a_flag_is_given_as_launch_takes_it(yes: str, no: str) -> None:
    assert "--ni" in words_of("stand", {"ni": yes, "scene": "x"})
    assert "--ni" not in words_of("stand", {"ni": no, "scene": "x"})
    with pytest.raises(LaunchArgumentError, match=r"^stand.launch.py: argument ni: given 'perhaps'; allowed: true or"):
        words_of("stand", {"ni": "perhaps", "scene": "x"})


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("mpa", r"bench.launch.py: unknown argument mpa; did you mean map\?; allowed: scene, out, map, "),
        ("sigterm_timeout", "unknown argument sigterm_timeout; "),
        ("real_time", "unknown argument real_time; "),
    ],
)
def test_an_unknown_argument_is_refused(given: str, line: str) -> None:
    with pytest.raises(LaunchArgumentError, match=line):
        check_names("bench", ["scene", given])


def test_what_launch_itself_reads_is_known() -> None:
    check_names("bench", ["scene", "emulate_tty", "ros_namespace", "launch-prefix"])


def test_arguments_of_an_including_launch_file_are_none_of_ours() -> None:
    bench = next(file for file in FILES if file.name == "bench.launch.py")
    for words in (["launch", "atpid_control", "bench.launch.py", "scene:=a"], ["launch", str(bench)]):
        assert is_asked_for(bench, words)
    assert not is_asked_for(bench, ["launch", "/other/outer.launch.py", "mine:=1"])
    assert not is_asked_for(bench, ["launch", "other", "outer.launch.py"])


@pytest.mark.parametrize(("given", "used"), [("lab1", "/lab1"), ("/a/b/", "/a/b")])
def test_a_namespace_is_written_as_ros_does(given: str, used: str) -> None:
    assert namespace(given) == used
    for wrong in ("1 2", "", "/"):
        with pytest.raises(argparse.ArgumentTypeError, match="allowed: the name"):
            namespace(wrong)


def test_the_arguments_need_the_standard_library_only() -> None:
    """`ros2 launch` runs in the Python of the ROS installation, without the project's requirements."""
    sources = f"{ROOT / 'atpid_interfaces/atpid_common'}:{ROOT / 'atpid_control'}"
    done = subprocess.run(
        [sys.executable, "-S", "-c", "import atpid_control.stand.launching.arguments"],
        env={"PYTHONPATH": sources, "LD_LIBRARY_PATH": os.environ.get("LD_LIBRARY_PATH", "")},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
