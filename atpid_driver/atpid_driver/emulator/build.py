# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Builds firmware and emulator when they are needed; make decides what is out of date."""

import fcntl
import shutil
import subprocess
from pathlib import Path
from typing import Final

from atpid_common.errors import InputError
from atpid_common.folders import cache_root, content_key, share_folder

SOURCE: Final = Path(__file__).resolve().parent / "data"
PACKAGES: Final = "gcc-avr avr-libc binutils-avr arduino-core-avr libsimavr-dev libelf-dev"

_NEEDED: Final[dict[str, Path]] = {
    "gcc-avr": Path("/usr/bin/avr-g++"),
    "binutils-avr": Path("/usr/bin/avr-objcopy"),
    "avr-libc": Path("/usr/lib/avr/include/avr/io.h"),
    "arduino-core-avr": Path("/usr/share/arduino/hardware/arduino/avr/cores/arduino/Arduino.h"),
    "libsimavr-dev": Path("/usr/include/simavr/sim_avr.h"),
    "libelf-dev": Path("/usr/include/libelf.h"),
}


class EmulatorUnavailableError(InputError):
    """Tools to build the firmware or the emulator are missing, or a build failed."""


def missing_tools() -> tuple[str, ...]:
    """Return the Debian packages that are missing on this machine to build firmware and emulator."""
    return tuple(package for package, witness in _NEEDED.items() if not witness.exists())


def build_firmware(table: Path | None = None, folder: Path | None = None) -> Path:
    """Build the firmware and return its ELF file; `table` is an exported look-up table's header.

    Raises `EmulatorUnavailableError` where the tools are missing or the build fails.
    """
    source = share_folder("atpid_driver") / "firmware"
    build = folder or _build_folder("firmware", source)
    _make(source, build, *([f"TABLE={table}"] if table else []))
    return build / "atpid_motor.elf"


def build_emulator() -> Path:
    """Build the emulator and return its executable. Raises `EmulatorUnavailableError` as `build_firmware`."""
    build = _build_folder("emulator", SOURCE)
    _make(SOURCE, build)
    return build / "emulator"


def _build_folder(name: str, source: Path) -> Path:
    """Return where to build, a folder of the user's cache named after the contents of the sources."""
    built = source / "build"
    files = (path for path in source.rglob("*") if path.is_file() and built not in path.parents)
    return cache_root() / f"{name}-{content_key(source, files)}"


def _make(source: Path, build: Path, *variables: str) -> None:
    missing = missing_tools()
    if missing or not shutil.which("make"):
        raise EmulatorUnavailableError(
            f"the emulated motor stand needs {', '.join(missing or ('make',))}: sudo apt-get install {PACKAGES}"
        )
    build.mkdir(parents=True, exist_ok=True)
    command = ["make", "-C", str(source), f"BUILD={build}", *variables]
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two test runs at once must not build into each other
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise EmulatorUnavailableError(f"make in {source} failed: {(done.stderr or done.stdout).strip()}")
