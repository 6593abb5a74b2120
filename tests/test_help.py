# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the commands help with: an example each, the nearest match of a mistyped word, completion."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from atpid_common.cli import full_parser, load
from atpid_control.cli import COMMANDS as ATPID
from atpid_control.cli import main as atpid
from atpid_control.completion import SHELLS, script
from studies.cli import COMMANDS as STUDIES
from studies.cli import main as studies

PROGRAMS = {"atpid": ATPID, "python -m studies": STUDIES}
PARSERS = {program: full_parser(program, groups) for program, groups in PROGRAMS.items()}
MAIN = {"atpid": atpid, "python -m studies": studies}
EXAMPLES = {
    (program, name): shlex.split(load(place).EXAMPLE)
    for program, groups in PROGRAMS.items()
    for group in groups.values()
    for name, (place, _) in group.items()
}


@pytest.mark.parametrize(("program", "command"), EXAMPLES)
def test_the_example_is_in_the_help_and_is_parsed(
    program: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = EXAMPLES[program, command]
    assert PARSERS[program].parse_args([*command.split(), *words]).run
    with pytest.raises(SystemExit, match="0"):
        PARSERS[program].parse_args([*command.split(), "--help"])
    assert f"  {program} {command} {shlex.join(words)}\n" in capsys.readouterr().out or not words


@pytest.mark.parametrize(
    ("line", "given", "meant"),
    [
        ("atpid benhc", "benhc", "bench"),
        ("atpid zzz", "zzz", None),
        ("atpid bench scenes/standard.yaml --out x --realtime", "--realtime", "--real-time"),
        ("atpid validate a", "validate", "bag validate"),
        ("atpid design --mass=2 --outt x", "--outt", "--out"),
        ("atpid simulate a.yaml --height 0,2", "0,2", "0.2"),
        ("atpid map a.yaml --mass-fractions 0.1 --amplitudes 0,1:0,3:5 --out a.npz", "0,1:0,3:5", "0.1:0.3:5"),
        ("atpid simulate a.yaml b.yaml", "b.yaml", None),
        ("atpid select a.yaml --method dirct", "dirct", "direct"),
        ("python -m studies thesis freedecay --out x", "freedecay", "free_decay"),
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


@pytest.mark.parametrize("shell", SHELLS)
def test_the_functions_are_those_of_the_parsers(shell: str, tmp_path: Path) -> None:
    file = tmp_path / "made" / shell
    assert atpid(["completion", shell, "--out", str(file)]) == 0
    text = file.read_text()
    assert text == script(shell) + "\n"
    assert [word for word in ("simulate", "--fidelity", "finite", "--mass-fractions") if word not in text] == []
    if found := shutil.which(shell):
        assert subprocess.run([found, "-n", file], capture_output=True, check=False).returncode == 0
