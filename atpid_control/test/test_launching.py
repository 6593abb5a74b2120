# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The arguments of the launch files, and what the processes of a graph load at their start. No `launch` needed."""

import argparse
import os
import re
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
FILES = {file.name.partition(".")[0]: file for file in (ROOT / "atpid_control" / "launch").glob("*.launch.py")}


def parser_of(command: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(exit_on_error=False)
    __import__(COMMANDS[command], fromlist=["add_arguments"]).add_arguments(parser)
    return parser


def given_to(command: str, **arguments: str) -> argparse.Namespace:
    """Return what the command is given by a launch file with these arguments."""
    name, *words = words_of(command, arguments)
    assert name == command
    return parser_of(command).parse_args(words)


def test_each_launch_file_starts_the_command_of_its_name() -> None:
    assert set(FILES) == set(OPTIONS) <= set(COMMANDS)
    for command, file in FILES.items():
        assert f"atpid {command}`" in file.read_text()


@pytest.mark.parametrize("command", OPTIONS)
def test_the_arguments_are_the_options_of_the_command_with_its_defaults(command: str) -> None:
    parser, arguments = parser_of(command), {argument.name: argument for argument in arguments_of(command)}
    usual, always = vars(parser.parse_args(["x"])), {"real_time": True} if command == "bench" else {}
    assert list(arguments) == [name for name in usual if name not in always]
    for argument in arguments.values():
        assert argument.description
        assert "%" not in argument.description
    (operand,) = (name for name, argument in arguments.items() if argument.default is None)
    chosen = [",".join(argument.choices) for argument in arguments.values() if argument.choices]
    assert chosen == re.findall(r"\{([\w,]+)\}", parser.format_usage())
    defaults = {name: argument.default or "" for name, argument in arguments.items()}
    assert vars(given_to(command, **defaults | {operand: "x"})) == usual | always


def test_each_argument_reaches_the_command() -> None:
    args = given_to(
        "stand", scene="a scene.yaml", map="~/map.npz", bag="-odd", ni="True", labjack_config="l.yaml", restarts="2",
        params_file="p.yaml", namespace="lab1", log_level="warn", move="0.1", live="yes", live_port="9000",
    )  # fmt: skip
    assert (args.scene, args.map, args.bag) == (Path("a scene.yaml"), Path("~/map.npz").expanduser(), Path("-odd"))
    assert (args.ni, args.live, args.live_port) == (True, True, 9000)
    assert (args.labjack_config, args.params_file) == (Path("l.yaml"), Path("p.yaml"))
    assert (args.namespace, args.log_level, args.restarts, args.move) == ("/lab1", "warn", 2, 0.1)


def test_a_flag_is_given_as_launch_takes_it() -> None:
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
    bench = FILES["bench"]
    for words in (["launch", "atpid_control", "bench.launch.py", "scene:=a"], ["launch", str(bench)]):
        assert is_asked_for(bench, words)
    for words in (["launch", "/other/outer.launch.py", "mine:=1"], ["launch", "other", "outer.launch.py"]):
        assert not is_asked_for(bench, words)


def test_a_namespace_is_written_as_ros_does() -> None:
    assert [namespace(given) for given in ("lab1", "/a/b/")] == ["/lab1", "/a/b"]
    for wrong in ("1 2", "", "/"):
        with pytest.raises(argparse.ArgumentTypeError, match="allowed"):
            namespace(wrong)


def test_the_arguments_need_the_standard_library_only() -> None:
    """`ros2 launch` runs in the Python of the ROS installation, without the project's requirements."""
    sources = f"{ROOT / 'atpid_interfaces/atpid_common'}:{ROOT / 'atpid_control'}"
    command = [sys.executable, "-S", "-c", "import atpid_control.stand.launching.arguments"]
    environment = {"PYTHONPATH": sources, "LD_LIBRARY_PATH": os.environ.get("LD_LIBRARY_PATH", "")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


#: A graph has many processes: what simulates nothing starts without the libraries of what does.
LIGHT = [f"atpid_control.nodes.{name}_node" for name in ("supervisor", "recorder", "live", "foxglove", "replay")]
LIGHT += [f"atpid_control.commands.{name}" for name in ("bag_files", "bag_views", "replay", "doctor")]
BENCH = ["atpid_control.commands.bench", "atpid_control.stand.summary"]
SLOW = [f"scipy.{name}" for name in ("interpolate", "optimize", "signal", "stats")]
#: Imports modules one after the other up to the first with which what is not allowed is there, too.
CODE = """
import importlib, sys
modules, heavy = (words.split() for words in sys.argv[1:])
for module in modules:
    importlib.import_module(module)
    if found := set(heavy) & set(sys.modules):
        sys.exit(f"{module}: {found}")
"""


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        (["atpid_sim.scene", *LIGHT], ["numba", "scipy", "matplotlib", "plotly", "pandas"]),
        (BENCH, SLOW),
        (["atpid_control.nodes.identifier_node"], ["atpid_sim.engine"]),
    ],
    ids=["nodes and commands", "bench", "identifier"],
)
def test_it_is_imported_without(modules: list[str], heavy: list[str]) -> None:
    command = [sys.executable, "-c", CODE, " ".join(modules), " ".join(heavy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
