# SPDX-License-Identifier: Apache-2.0
"""The help of every command ends with an example, which is run or read by the real parser; a mistyped word is named."""

import importlib
import shlex
from pathlib import Path

import pytest
from colcon_workspace import ROOT

from atpid_common.cli import Commands, Parser, full_parser
from atpid_common.suggestion import did_you_mean

PROGRAMS = ("atpid_control", "atpid_driver", "atpid_sim")
#: Modules with one command each, which parses what follows their name.
SINGLE = (
    "atpid_common.nodes.echo", "atpid_common.nodes.lifecycle", "atpid_common.nodes.param",
    "atpid_control.nodes.policy", "atpid_control.recording", "atpid_driver.emulator.__main__",
)  # fmt: skip
#: Examples that take seconds, and a line of what they print. Those of the others are in the documentation too, whose
#: commands tests run with smaller numbers (tests/test_docs.py).
QUICK = {
    ("atpid_sim", "simulate"): "efficiency",
    ("atpid_sim", "sweep"): "500",
    ("atpid_control", "select"): "pca at 0.03 m",
    ("atpid_control", "study"): "free_decay",
    ("atpid_control", "report"): "report.html",
}


def commands_of(program: str) -> Commands:
    commands: Commands = importlib.import_module(f"{program}.cli").COMMANDS
    return commands


COMMANDS = [(program, command) for program in PROGRAMS for command in commands_of(program)]


def example(program: str, command: str) -> list[str]:
    return shlex.split(importlib.import_module(commands_of(program)[command][0]).EXAMPLE)


@pytest.fixture(scope="module")
def parsers() -> dict[str, Parser]:
    return {program: full_parser(program, commands_of(program)) for program in PROGRAMS}


@pytest.fixture
def in_a_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work where the scenes and bags are, and nothing else."""
    for folder in ("scenes", "bags"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("program", "command"), COMMANDS)
def test_the_example_is_in_the_help_and_is_parsed(
    parsers: dict[str, Parser], program: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = example(program, command)
    assert parsers[program].parse_args([command, *words]).run
    with pytest.raises(SystemExit, match="0"):
        parsers[program].parse_args([command, "--help"])
    printed = capsys.readouterr().out
    assert printed.endswith(f"\nexample:\n  python -m {program} {command} {shlex.join(words)}\n")
    named = [word for word in words if word.startswith(("scenes/", "bags/"))]
    assert [word for word in named if not (ROOT / word).exists()] == []


@pytest.mark.slow
@pytest.mark.parametrize(("program", "command"), QUICK)
def test_the_example_runs(program: str, command: str, in_a_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main = importlib.import_module(f"{program}.cli").main
    assert main([command, *example(program, command)]) == 0
    assert QUICK[program, command] in capsys.readouterr().out


@pytest.mark.parametrize("module", SINGLE)
def test_a_program_of_one_command_shows_an_example(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    loaded = importlib.import_module(module)
    assert loaded.main(["--help"]) == 0
    program = module.removesuffix(".__main__")
    assert capsys.readouterr().out.endswith(f"\nexample:\n  python -m {program} {loaded.EXAMPLE}\n")


def test_the_example_of_recording_runs(in_a_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from atpid_control.recording import EXAMPLE, main

    assert main(shlex.split(EXAMPLE)) == 0
    assert "every one read and decoded" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("program", "words", "line"),
    [
        ("atpid_control", "benhc", "COMMAND: given benhc; did you mean bench?; allowed: bench, "),
        ("atpid_sim", "similate", "COMMAND: given similate; did you mean simulate?; allowed: simulate, "),
        ("atpid_sim", "zzz", "COMMAND: given zzz; allowed: simulate, "),
        (
            "atpid_control", "bench scenes/standard.yaml --out x --realtime",
            "given --realtime, which is no argument of it; did you mean --real-time?; what it takes: "
            "python -m atpid_control bench --help",
        ),
        (
            "atpid_sim", "simulate scenes/standard.yaml --hieght=0.1",
            "given --hieght=0.1, which is no argument of it; did you mean --height?; ",
        ),
        ("atpid_sim", "simulate a.yaml b.yaml", "given b.yaml, which is no argument of it; what it takes: "),
        ("atpid_control", "select a.yaml --method dirct", "--method: given dirct; did you mean direct?; allowed: "),
        ("atpid_sim", "simulate a.yaml --fidelity sofd", "--fidelity: given sofd; did you mean soft?; allowed: auto"),
        ("atpid_control", "study freedecay --out x", "study 'freedecay': there is none; did you mean free_decay?; "),
        ("atpid_control", "figures selektion --out x", "NAME: given selektion; did you mean selection?; allowed: "),
    ],
)  # fmt: skip
def test_a_mistyped_word_is_named_with_the_nearest(
    program: str, words: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main = importlib.import_module(f"{program}.cli").main
    assert main(words.split()) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"error: {line}")
    assert printed.count("\n") == 1


def test_a_word_like_none_has_no_hint() -> None:
    assert did_you_mean("zzz", ["lookup", "pca"]) == ""
    assert did_you_mean("looukp", ["lookup", "pca"]) == "; did you mean lookup?"
    assert did_you_mean("lookup", []) == ""
