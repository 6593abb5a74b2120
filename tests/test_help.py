# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the commands help with: an example each, the nearest match of a mistyped word, TAB in an interactive bash."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from documented import ROOT

from atpid_common.cli import Parser, full_parser, load
from atpid_common.errors import did_you_mean
from atpid_control.cli import commands as installed
from atpid_control.cli import main as atpid
from atpid_control.completion import SHELLS, script
from studies.cli import COMMANDS as STUDIES
from studies.cli import main as studies

PROGRAMS = {"atpid": installed(), "python -m studies": STUDIES}
MAIN: dict[str, Callable[[list[str]], int]] = {"atpid": atpid, "python -m studies": studies}
EXAMPLES = {
    (program, name): shlex.split(load(place).EXAMPLE)
    for program, groups in PROGRAMS.items()
    for group in groups.values()
    for name, (place, _) in group.items()
}
#: Examples that are run since they take no more than seconds, and a word of what each prints.
QUICK = {
    ("atpid", "simulate"): "efficiency",
    ("atpid", "select"): "pca",
    ("python -m studies", "thesis"): "free_decay",
    ("atpid", "bag report"): "report.html",
    ("atpid", "bag check"): "160",
}


@pytest.fixture(scope="module")
def parsers() -> dict[str, Parser]:
    return {program: full_parser(program, groups) for program, groups in PROGRAMS.items()}


@pytest.mark.parametrize(("program", "command"), EXAMPLES)
def test_the_example_is_in_the_help_and_is_parsed(
    parsers: dict[str, Parser], program: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = EXAMPLES[program, command]
    assert parsers[program].parse_args([*command.split(), *words]).run
    with pytest.raises(SystemExit, match="0"):
        parsers[program].parse_args([*command.split(), "--help"])
    assert f"  {program} {command} {shlex.join(words)}\n" in capsys.readouterr().out or not words
    named = [word for word in words if word.startswith(("scenes/", "bags/"))]
    assert [word for word in named if not (ROOT / word).exists()] == []


@pytest.mark.parametrize(("program", "command"), QUICK)
def test_the_example_runs(
    program: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("scenes", "bags"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    assert MAIN[program]([*command.split(), *EXAMPLES[program, command]]) == 0
    assert QUICK[program, command] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "given", "meant"),
    [
        ("atpid benhc", "benhc", "bench"),
        ("atpid similate", "similate", "simulate"),
        ("atpid zzz", "zzz", None),
        ("atpid bench scenes/standard.yaml --out x --realtime", "--realtime", "--real-time"),
        ("atpid simulate scenes/standard.yaml --hieght=0.1", "--hieght=0.1", "--height"),
        ("atpid validate a", "validate", "bag validate"),
        ("atpid design --mass=2 --outt x", "--outt", "--out"),
        ("atpid simulate a.yaml --height 0,2", "0,2", "0.2"),
        ("atpid simulate a.yaml --height 20mm", "20mm", None),
        ("atpid map a.yaml --mass-fractions 0.1 --amplitudes 0,1:0,3:5 --out a.npz", "0,1:0,3:5", "0.1:0.3:5"),
        ("atpid simulate a.yaml b.yaml", "b.yaml", None),
        ("atpid select a.yaml --method dirct", "dirct", "direct"),
        ("atpid simulate a.yaml --fidelity sofd", "sofd", "soft"),
        ("python -m studies thesis freedecay --out x", "freedecay", "free_decay"),
        ("python -m studies figures selektion --out x", "selektion", "selection"),
    ],
)
def test_a_mistyped_word_is_named_with_the_nearest(
    line: str, given: str, meant: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    program = next(program for program in PROGRAMS if line.startswith(program))
    assert MAIN[program](line.removeprefix(program).split()) == 2
    printed = capsys.readouterr().err
    assert re.fullmatch(rf"error: .*{re.escape(given)}[,;':].*\n", printed)
    hint = re.search(r"did you mean ([^?]*)\?|decimal point: (\S+);", printed)
    assert (hint and (hint[1] or hint[2])) == meant


def test_a_word_like_none_has_no_hint() -> None:
    assert did_you_mean("zzz", ["lookup", "pca"]) == did_you_mean("foo", ["motor", "drift"]) == ""
    assert did_you_mean("lookup", []) == ""
    assert " lookup?" in did_you_mean("looukp", ["lookup", "pca"])


#: Prints what an interactive bash would complete in each line of its input.
COMPLETE = r"""
. ros2_ws/activate
complete_it=$(complete -p atpid | sed 's/.* -F \([^ ]*\) .*/\1/')
while IFS= read -r COMP_LINE; do
    read -ra COMP_WORDS <<< "$COMP_LINE"
    [[ $COMP_LINE != *' ' ]] || COMP_WORDS+=('')
    COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMP_POINT=${#COMP_LINE}
    $complete_it
    echo "${COMPREPLY[*]}"
done
"""
COMPLETED = {
    "atpid ": "simulate",
    "atpid ben": "bench",
    "atpid bench scenes/thesis_4_3.ya": "scenes/thesis_4_3.yaml",
    "atpid bench --real": "--real-time",
    "atpid select scenes/thesis_4_3.yaml --meth": "--method",
    "atpid select scenes/thesis_4_3.yaml --method loo": "lookup",
    "atpid simulate scenes/standard.yaml --fidelity fin": "finite",
    "atpid bag export bags/rumble --format parq": "parquet",
    "atpid bag compare bags/rumble bags/cut": "bags/cut_off",
    "atpid bag report bags/thesis_4_3_short/meta": "bags/thesis_4_3_short/metadata.yaml",
    "atpid bag che": "check",
}


def test_tab_completes() -> None:
    settings = {"HOME": os.environ.get("HOME", "/tmp"), "PATH": os.defpath, "LANG": "C.UTF-8"}
    command = ["bash", "--noprofile", "--norc", "-i", "-c", COMPLETE]
    lines = "".join(f"{line}\n" for line in COMPLETED)
    ran = subprocess.run(command, input=lines, cwd=ROOT, env=settings, capture_output=True, text=True, check=False)
    offered = dict(zip(COMPLETED, ran.stdout.splitlines(), strict=True))
    assert [line for line, word in COMPLETED.items() if word not in offered[line].split()] == []


def test_a_script_that_activates_has_no_completion_and_the_commands_load_none() -> None:
    line = ". ros2_ws/activate && complete -p"
    ran = subprocess.run(["bash", "--norc", "-c", line], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "atpid" not in ran.stdout
    program = (
        "import sys; from atpid_control.cli import main; main(['simulate', '--help']); print('shtab' in sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "False"


@pytest.mark.parametrize("shell", SHELLS)
def test_the_functions_are_those_of_the_parsers(shell: str, tmp_path: Path) -> None:
    file = tmp_path / "made" / shell
    assert atpid(["completion", shell, "--out", str(file)]) == 0
    text = file.read_text()
    assert text == script(shell) + "\n"
    assert [word for word in ("simulate", "--fidelity", "finite", "--mass-fractions") if word not in text] == []
    if found := shutil.which(shell):
        assert subprocess.run([found, "-n", file], capture_output=True, check=False).returncode == 0
