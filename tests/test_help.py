# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The help of every command ends with an example, which is run or read by the real parser; a mistyped word is named."""

import shlex
from pathlib import Path

import pytest
from colcon_workspace import ROOT

from atpid_common.cli import Parser, full_parser, load
from atpid_common.errors import did_you_mean
from atpid_control.cli import COMMANDS as ATPID
from atpid_control.cli import main as atpid
from studies.cli import COMMANDS as STUDIES
from studies.cli import main as studies

PROGRAMS = {"atpid": ATPID, "python -m studies": STUDIES}
MAIN = {"atpid": atpid, "python -m studies": studies}
#: Examples that take seconds, and a line of what they print. Those of the others are in the documentation too, whose
#: commands tests run with smaller numbers (tests/test_docs.py).
QUICK = {
    ("atpid", "simulate"): "efficiency",
    ("python -m studies", "sweep"): "500",
    ("atpid", "select"): "pca at 0.03 m",
    ("python -m studies", "thesis"): "free_decay",
    ("atpid", "bag report"): "report.html",
    ("atpid", "bag verify"): "every one read and decoded",
    ("atpid", "bag check"): "160 blocks answered",
}
COMMANDS = [(program, name) for program, groups in PROGRAMS.items() for group in groups.values() for name in group]


def example(program: str, name: str) -> list[str]:
    (place,) = (group[name][0] for group in PROGRAMS[program].values() if name in group)
    return shlex.split(load(place).EXAMPLE)


@pytest.fixture(scope="module")
def parsers() -> dict[str, Parser]:
    return {program: full_parser(program, groups) for program, groups in PROGRAMS.items()}


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
    assert parsers[program].parse_args([*command.split(), *words]).run
    with pytest.raises(SystemExit, match="0"):
        parsers[program].parse_args([*command.split(), "--help"])
    printed = capsys.readouterr().out
    if words:
        assert printed.endswith(f"\nexample:\n  {program} {command} {shlex.join(words)}\n")
    named = [word for word in words if word.startswith(("scenes/", "bags/"))]
    assert [word for word in named if not (ROOT / word).exists()] == []


@pytest.mark.slow
@pytest.mark.parametrize(("program", "command"), QUICK)
def test_the_example_runs(program: str, command: str, in_a_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert MAIN[program]([*command.split(), *example(program, command)]) == 0
    assert QUICK[program, command] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("program", "words", "line"),
    [
        ("atpid", "benhc", "COMMAND: given benhc; did you mean bench?; allowed: simulate, "),
        ("atpid", "similate", "COMMAND: given similate; did you mean simulate?; allowed: simulate, "),
        ("atpid", "zzz", "COMMAND: given zzz; allowed: simulate, "),
        (
            "atpid", "bench scenes/standard.yaml --out x --realtime",
            "given --realtime, which is no argument of it; did you mean --real-time?; what it takes: "
            "atpid bench --help",
        ),
        (
            "atpid", "simulate scenes/standard.yaml --hieght=0.1",
            "given --hieght=0.1, which is no argument of it; did you mean --height?; ",
        ),
        ("atpid", "validate a", "COMMAND: given validate; did you mean bag validate?; allowed: simulate, "),
        (
            "atpid", "design --mass=2 --outt x",
            "the following arguments are required: --amplitudes, --out; given --outt; did you "
            "mean --out?; ",
        ),
        ("atpid", "simulate a.yaml --height 0,2", "--height: given 0,2; allowed: a number with a decimal point: 0.2; "),
        ("atpid", "simulate a.yaml --height 20mm", "--height: given 20mm; allowed: above 0 to 1e+09 m, without the un"),
        (
            "atpid", "map a.yaml --mass-fractions 0.1 --amplitudes 0,01:0,03:5 --out a.npz",
            "--amplitudes: given 0,01:0,03:5; allowed: a number with a decimal point: 0.01:0.03:5; ",
        ),
        ("atpid", "simulate a.yaml b.yaml", "given b.yaml, which is no argument of it; what it takes: "),
        ("atpid", "select a.yaml --method dirct", "--method: given dirct; did you mean direct?; allowed: "),
        ("atpid", "simulate a.yaml --fidelity sofd", "--fidelity: given sofd; did you mean soft?; allowed: auto"),
        ("python -m studies", "thesis freedecay --out x", "study 'freedecay': there is none; did you mean free_decay?"),
        ("python -m studies", "figures selektion --out x", "NAME: given selektion; did you mean selection?; allowed: "),
    ],
)  # fmt: skip
def test_a_mistyped_word_is_named_with_the_nearest(
    program: str, words: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert MAIN[program](words.split()) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"error: {line}")
    assert printed.count("\n") == 1


def test_a_word_like_none_has_no_hint() -> None:
    assert did_you_mean("zzz", ["lookup", "pca"]) == ""
    assert did_you_mean("foo", ["motor", "drift"]) == ""
    assert did_you_mean("looukp", ["lookup", "pca"]) == "; did you mean lookup?"
    assert did_you_mean("lookup", []) == ""
