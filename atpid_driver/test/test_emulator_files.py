# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The emulator and what lies where its port and its EEPROM shall be: a file of the user is never replaced."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import driver_program
import pytest
from motor_rigs import board

from atpid_driver.emulator import Emulator
from atpid_driver.emulator.emulator import EEPROM_SIZE, EmulatorError

IN_THE_WAY: dict[str, Callable[[Path], object]] = {
    "a file": lambda path: path.write_text("mine"),
    "a folder": Path.mkdir,
    "a link to a file": lambda path: path.symlink_to(__file__),
    "no folder": lambda path: path.parent.rmdir(),
}


def seen(path: Path) -> tuple[int, ...] | None:
    """Return what changes with a file; None where there is none."""
    if not os.path.lexists(path):
        return None
    found = os.lstat(path)
    return found.st_mode, found.st_ino, found.st_size, found.st_mtime_ns


@pytest.mark.parametrize("option", ["--link", "--eeprom"])
@pytest.mark.parametrize("kind", IN_THE_WAY)
def test_what_is_in_the_way_is_refused_in_one_line_and_stays(tmp_path: Path, option: str, kind: str) -> None:
    path = tmp_path / "folder" / "it"
    path.parent.mkdir()
    IN_THE_WAY[kind](path)
    before = seen(path)
    places = {"--link": str(tmp_path / "port")} | {option: str(path)}
    command = [
        sys.executable,
        driver_program.__file__,
        "emulator",
        *(word for pair in places.items() for word in pair),
    ]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False, timeout=300)
    assert done.returncode == 2, done
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {option} {path}: ")
    assert seen(path) == before


def test_what_a_killed_emulator_left_behind_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "board").symlink_to("/dev/pts/99")
    (tmp_path / "eeprom").write_bytes(bytes(EEPROM_SIZE))
    with board(tmp_path) as emulator:
        assert (tmp_path / "board").is_symlink()
        assert emulator.state().board
    assert not (tmp_path / "board").is_symlink()
    assert (tmp_path / "eeprom").stat().st_size == EEPROM_SIZE


def test_a_file_that_took_the_ports_place_stays(tmp_path: Path) -> None:
    with board(tmp_path) as emulator:
        assert isinstance(emulator, Emulator)
        (tmp_path / "board").unlink()
        (tmp_path / "board").write_text("mine")
        emulator.do("unplug")
        with pytest.raises(EmulatorError, match="no pty"):
            emulator.do("plug")
    assert (tmp_path / "board").read_text() == "mine"
