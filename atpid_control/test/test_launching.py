# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The arguments of the launch files; no `launch` needed."""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import pytest

from atpid_control.cli import commands
from atpid_control.stand.launching.options import (
    OPTIONS,
    LaunchArgumentError,
    arguments_of,
    check_names,
    default_of,
    is_asked_for,
    namespace,
    words_of,
)

COMMANDS = {name: place for group in commands().values() for name, (place, _) in group.items()}
ROOT = Path(__file__).resolve().parents[2]


def parser_of(command: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(exit_on_error=False)
    __import__(COMMANDS[command], fromlist=["add_arguments"]).add_arguments(parser)
    return parser


def given_to(command: str, **arguments: str) -> argparse.Namespace:
    """Return what the command is given by a launch file with these arguments."""
    name, *words = words_of(command, arguments)
    assert name == command
    return parser_of(command).parse_args(words)


@pytest.mark.parametrize("command", OPTIONS)
def test_the_arguments_are_the_options_of_the_command_with_its_defaults(command: str) -> None:
    parser, arguments = parser_of(command), arguments_of(command)
    usual, always = vars(parser.parse_args(["x"])), {"real_time": True} if command == "bench" else {}
    assert list(arguments) == [name for name in usual if name not in always]
    (operand,) = (name for name, option in arguments.items() if default_of(option) is None)
    defaults = {name: default_of(option) or "" for name, option in arguments.items()}
    assert vars(given_to(command, **defaults | {operand: "x"})) == usual | always


def test_values_and_flags_are_given_as_launch_takes_them() -> None:
    args = given_to("stand", scene="a scene.yaml", map="~/map.npz", bag="-odd", namespace="lab1", live_port="9000")
    assert (args.scene, args.map, args.bag) == (Path("a scene.yaml"), Path("~/map.npz").expanduser(), Path("-odd"))
    assert (args.namespace, args.live_port) == ("/lab1", 9000)
    with pytest.raises(argparse.ArgumentTypeError, match="allowed"):
        namespace("1 2")
    for yes in ("true", "True", "TRUE", "1", "yes", "on"):
        assert given_to("stand", ni=yes, scene="x").ni
    for no in ("false", "False", "0", "no", "off", ""):
        assert not given_to("stand", ni=no, scene="x").ni
    with pytest.raises(LaunchArgumentError, match=r"^stand\.launch\.py: .*\bni: .*'perhaps'; .*true.*false"):
        words_of("stand", {"ni": "perhaps", "scene": "x"})


@pytest.mark.parametrize("given", ["mpa", "sigterm_timeout", "real_time"])
def test_an_unknown_argument_is_refused_and_what_launch_itself_reads_is_known(given: str) -> None:
    hint = r"map\?.*" if given == "mpa" else ""
    with pytest.raises(LaunchArgumentError, match=rf"^bench\.launch\.py: .*\b{given}; .*{hint}: scene,"):
        check_names("bench", ["scene", given])
    check_names("bench", ["scene", "emulate_tty", "ros_namespace", "launch-prefix"])


def test_arguments_of_an_including_launch_file_are_none_of_ours() -> None:
    bench = ROOT / "atpid_control/launch/bench.launch.py"
    for words in (["launch", "atpid_control", "bench.launch.py", "scene:=a"], ["launch", str(bench)]):
        assert is_asked_for(bench, words)
    for words in (["launch", "/other/outer.launch.py", "mine:=1"], ["launch", "other", "outer.launch.py"]):
        assert not is_asked_for(bench, words)


def test_the_arguments_need_the_standard_library_only() -> None:
    """`ros2 launch` runs in the Python of the ROS installation, without the project's requirements."""
    sources = f"{ROOT / 'atpid_interfaces/atpid_common'}:{ROOT / 'atpid_control'}"
    command = [sys.executable, "-S", "-c", "import atpid_control.stand.launching.options"]
    environment = {"PYTHONPATH": sources, "LD_LIBRARY_PATH": os.environ.get("LD_LIBRARY_PATH", "")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
