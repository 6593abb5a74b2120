# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The emulator as a context manager: build it with the firmware, start, run, inject faults, read the state, end."""

from __future__ import annotations

import fcntl
import json
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from atpid_common.errors import InputError
from atpid_common.folders import cache_root, content_key, share_folder

_SOURCE: Final = Path(__file__).resolve().parent / "data"
PACKAGES: Final = "gcc-avr avr-libc binutils-avr arduino-core-avr libsimavr-dev libelf-dev"

_NEEDED: Final[dict[str, Path]] = {
    "gcc-avr": Path("/usr/bin/avr-g++"),
    "binutils-avr": Path("/usr/bin/avr-objcopy"),
    "avr-libc": Path("/usr/lib/avr/include/avr/io.h"),
    "arduino-core-avr": Path("/usr/share/arduino/hardware/arduino/avr/cores/arduino/Arduino.h"),
    "libsimavr-dev": Path("/usr/include/simavr/sim_avr.h"),
    "libelf-dev": Path("/usr/include/libelf.h"),
}


class EmulatorError(InputError):
    """The emulator cannot be built, for want of tools or otherwise, or it refused a command or ended."""


def missing_tools() -> tuple[str, ...]:
    """Return the Debian packages that are missing on this machine to build firmware and emulator."""
    return tuple(package for package, witness in _NEEDED.items() if not witness.exists())


def build_firmware(table: Path | None = None, folder: Path | None = None) -> Path:
    """Build the firmware and return its ELF file; `table` is an exported look-up table's header.

    Raises `EmulatorError` where the tools are missing or the build fails.
    """
    source = share_folder("atpid_driver") / "firmware"
    build = folder or _build_folder("firmware", source)
    _make(source, build, *([f"TABLE={table}"] if table else []))
    return build / "atpid_motor.elf"


def build_emulator() -> Path:
    """Build the emulator and return its executable. Raises `EmulatorError` as `build_firmware`."""
    build = _build_folder("emulator", _SOURCE)
    _make(_SOURCE, build)
    return build / "emulator"


def _build_folder(name: str, source: Path) -> Path:
    """Return where to build, a folder of the user's cache named after the contents of the sources."""
    built = source / "build"
    files = (path for path in source.rglob("*") if path.is_file() and built not in path.parents)
    return cache_root() / f"{name}-{content_key(source, files)}"


def _make(source: Path, build: Path, *variables: str) -> None:
    missing = missing_tools()
    if missing or not shutil.which("make"):
        raise EmulatorError(
            f"the emulated motor stand needs {', '.join(missing or ('make',))}: sudo apt-get install {PACKAGES}"
        )
    build.mkdir(parents=True, exist_ok=True)
    command = ["make", "-C", str(source), f"BUILD={build}", *variables]
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two test runs at once must not build into each other
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise EmulatorError(f"make in {source} failed: {(done.stderr or done.stdout).strip()}")


EEPROM_SIZE = 4096  # of the ATmega2560


@dataclass(frozen=True, slots=True)
class _StandState:
    """True state of the emulated stand; times in the board's own milliseconds since the emulator's start."""

    board: str
    ms: float
    motor: int
    height_um: float
    travel_um: float
    switched: int
    resets: int
    motor_off_ms: float
    last_byte_ms: float
    open: bool


class Emulator:
    """The real firmware on an emulated board, its serial port at `link`; time stops until `run` or `pace`.

    `height` [m] is the true initial height of the ceiling, `bootloader` [s] how long the board ignores input after a
    restart, `reset_on_open` whether opening the port restarts the board, as on a real one.
    """

    def __init__(
        self,
        link: Path,
        *,
        firmware: Path | None = None,
        eeprom: Path | None = None,
        height: float = 0.3,
        bootloader: float = 0.0,
        reset_on_open: bool = False,
    ) -> None:
        """Start it. Raises `EmulatorError` where it cannot be built, or for a path in use."""
        _check_link(link)
        if eeprom is not None:
            _check_eeprom(eeprom)
        self.link = link
        arguments = [str(build_emulator()), str(firmware or build_firmware()), "--link", str(link)]
        arguments += ["--height", f"{height * 1e6:.1f}", "--bootloader", f"{bootloader * 1e3:.3f}"]
        arguments += ["--eeprom", str(eeprom)] if eeprom else []
        arguments += ["--reset-on-open"] if reset_on_open else []
        self._process = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        if (answer := self._answer()) != "ready":
            self.close()
            raise EmulatorError(f"emulator did not start: {answer!r}")

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, seconds: float) -> None:
        """Advance simulated time by `seconds`, as fast as this machine can."""
        self.do(f"run {seconds * 1e3:.3f}")

    def drain(self, seconds: float = 0.0) -> None:
        """Run until the board has received all that was sent, then for `seconds`."""
        self.do(f"drain {seconds * 1e3:.3f}")

    def pace(self, factor: float) -> None:
        """Run at `factor` times real time; 0: stop, as a board that hangs."""
        self.do(f"pace {factor}")

    def set(self, name: str, value: str | int | float) -> None:
        """Inject or clear a fault of the stand: see data/stand.h for names and values."""
        self.do(f"set {name} {value}")

    def send(self, data: bytes) -> None:
        """Send bytes straight to the board; use it without a host at the port."""
        for start in range(0, len(data), 30_000):
            self.do(f"send {data[start : start + 30_000].hex()}")

    def received(self) -> bytes:
        """Return what the board sent since the last call; empty while a host has the port."""
        return bytes.fromhex(self.command("recv"))

    def state(self) -> _StandState:
        """Return the true state of the stand."""
        values = json.loads(self.command("state"))
        return _StandState(**values | {"open": bool(values["open"])})

    def close(self) -> None:
        """Power off and end."""
        if self._process.poll() is None and self._process.stdin is not None:
            self._process.stdin.close()
            self._process.wait(timeout=10)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def do(self, command: str) -> None:
        """Carry out a command without an answer; EmulatorError where it is refused.

        `reset` presses the button; `hang` makes the main program hang, `hang off` with interrupts off; `power 0` and
        `power 1` switch the supply; `unplug` and `plug` let the port disappear and appear again under the same name.
        """
        answer = self.command(command)
        if answer != "ok":
            raise EmulatorError(f"emulator: {command[:60]}: {answer}")

    def command(self, line: str) -> str:
        """Send a line to the emulator as it is and return its answer (data/emulator.c lists the commands)."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise EmulatorError(f"emulator ended with status {self._process.wait(timeout=10)}")
        return line.rstrip("\n")


def _check_link(link: Path) -> None:
    """Raise EmulatorError where `link` is anything but what an emulator that was killed leaves behind."""
    left_behind = link.is_symlink() and link.readlink().parent == Path("/dev/pts")
    if (link.exists() or link.is_symlink()) and not left_behind:
        raise EmulatorError(f"--link {link}: exists and is no port of an emulator; give the name of a new file")
    if not link.parent.is_dir():
        raise EmulatorError(f"--link {link}: there is no folder {link.parent}")


def _check_eeprom(path: Path) -> None:
    """Raise EmulatorError where `path` cannot be an EEPROM's contents: it would be replaced when the board ends."""
    if path.exists() and not (path.is_file() and path.stat().st_size == EEPROM_SIZE):
        raise EmulatorError(f"--eeprom {path}: exists and is no EEPROM of {EEPROM_SIZE} bytes; give a new file's name")
    if not path.parent.is_dir():
        raise EmulatorError(f"--eeprom {path}: there is no folder {path.parent}")
