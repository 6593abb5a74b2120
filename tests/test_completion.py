# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""TAB in a real, interactive bash: commands, options, methods, scenes and files, after `. ros2_ws/activate`."""

import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from colcon_workspace import ROOT

from atpid_control.cli import main
from atpid_control.completion import SHELLS, script

LIMIT = 120.0  # for what takes 2 s on a quiet machine [s]
PROMPT = b"ready> "
CLEAR = b"\x15"  # Ctrl-U: removes the line typed so far


class Terminal:
    """A shell on a pseudo-terminal, wide enough for a line."""

    def __init__(self, *command: str) -> None:
        self._own, other = pty.openpty()
        settings = {
            "HOME": os.environ.get("HOME", "/tmp"), "PATH": os.defpath, "TERM": "dumb", "PS1": PROMPT.decode(),
            "LANG": "C.UTF-8", "COLUMNS": "400", "INPUTRC": "/dev/null",
        }  # fmt: skip
        self._shell = subprocess.Popen(
            command, stdin=other, stdout=other, stderr=other, cwd=ROOT, env=settings, start_new_session=True
        )
        os.close(other)

    def send(self, text: bytes) -> None:
        os.write(self._own, text)

    def until(self, expected: bytes) -> bytes:
        """Return what is shown up to `expected`; fail where it is not shown."""
        shown, end = b"", time.monotonic() + LIMIT
        while expected not in shown:
            ready, _, _ = select.select([self._own], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"{expected!r} is not shown; shown: {shown!r}"
            shown += os.read(self._own, 65536)
        return shown

    def close(self) -> None:
        os.killpg(self._shell.pid, signal.SIGKILL)
        self._shell.wait()
        os.close(self._own)


@pytest.fixture(scope="module")
def terminal() -> Iterator[Terminal]:
    opened = Terminal(shutil.which("bash") or "bash", "--noprofile", "--norc", "-i")
    try:
        opened.until(PROMPT)
        opened.send(b"set +o history; bind 'set bell-style none'; bind 'set enable-bracketed-paste off'\r")
        opened.until(PROMPT)
        opened.send(b". ros2_ws/activate\r")
        opened.until(PROMPT)
        yield opened
    finally:
        opened.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("typed", "added"),
    [
        ("atp", "id "),
        ("atpid ben", "ch "),
        ("atpid bench scenes/thesis_4_3.ya", "ml "),
        ("atpid bench --real", "-time "),
        ("atpid select scenes/thesis_4_3.yaml --meth", "od "),
        ("atpid select scenes/thesis_4_3.yaml --method loo", "kup "),
        ("atpid simulate scenes/standard.yaml --fidelity fin", "ite "),
        ("atpid bag export bags/rumble --format parq", "uet "),
        ("atpid bag compare bags/rumble bags/cut", "_off/"),
        ("atpid simulate scen", "es/"),
        ("atpid bag report bags/thesis_4_3_short/meta", "data.yaml "),
        ("atpid cal", "ibrate "),
        ("atpid bag ver", "ify "),
        ("python ros2_ws/boot", "strap.py "),  # what is not ours, as before
        ("python -m json.tool scenes/thesis_4_3.ya", "ml "),
    ],
)
def test_tab_completes(terminal: Terminal, typed: str, added: str) -> None:
    terminal.send(typed.encode() + b"\t")
    try:
        terminal.until(f"{typed}{added}".encode())
    finally:
        terminal.send(CLEAR + b"\r")
        terminal.until(PROMPT)


@pytest.mark.slow
def test_tab_twice_lists_the_commands(terminal: Terminal) -> None:
    terminal.send(b"atpid \t\t")
    shown = terminal.until(b"stand")
    assert b"simulate" in shown
    terminal.send(CLEAR + b"\r")
    terminal.until(PROMPT)


def test_a_script_that_activates_has_no_completion() -> None:
    line = ". ros2_ws/activate && complete -p"
    ran = subprocess.run(["bash", "--norc", "-c", line], cwd=ROOT, capture_output=True, text=True, timeout=LIMIT)
    assert "atpid" not in ran.stdout


def test_the_commands_start_without_it() -> None:
    program = "import sys; from atpid_control.cli import main; main(['simulate', '--help'])"
    program += "; assert 'shtab' not in sys.modules"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=LIMIT)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("shell", SHELLS)
def test_the_functions_are_those_of_the_parsers(shell: str, tmp_path: Path) -> None:
    file = tmp_path / "made" / shell
    assert main(["completion", shell, "--out", str(file)]) == 0
    text = file.read_text()
    assert text == script(shell) + "\n"
    for word in ("simulate", "--fidelity", "finite", "--mass-fractions"):
        assert word in text
    found = shutil.which(shell)
    if found is not None:
        assert subprocess.run([found, "-n", file], capture_output=True, timeout=LIMIT).returncode == 0
