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
from atpid_driver.motor.faults import ProtocolError
from atpid_driver.motor.protocol import Frame, Reply, StateReply, decode, encode, reply_of

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


EEPROM_SIZE = 4096  # of the ATmega2560


class EmulatorError(InputError):
    """The emulator refused a command or ended."""


@dataclass(frozen=True, slots=True)
class StandState:
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
        """Start it. Raises `EmulatorUnavailableError` where it cannot be built, `EmulatorError` for a path in use."""
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

    def state(self) -> StandState:
        """Return the true state of the stand."""
        values = json.loads(self.command("state"))
        return StandState(**values | {"open": bool(values["open"])})

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


BEAT_TIME = 0.1
BOOT_TIME = 0.05


class SteppedHost:
    """Sends requests and steps simulated time explicitly; there is no port and no thread."""

    def __init__(self, emulator: Emulator) -> None:
        """Disconnect the serial port and let the board start."""
        self.emulator = emulator
        self.sequence = 0
        emulator.do("unplug")
        emulator.run(BOOT_TIME)
        emulator.received()

    def frame(self, word: str, *arguments: int | str) -> bytes:
        """Return the next request's bytes."""
        self.sequence = (self.sequence + 1) % 65536
        return encode(self.sequence, word, *arguments)

    def request(self, word: str, *arguments: int | str, seconds: float = 0.01) -> Reply:
        """Send a command, advance by `seconds`, return the answer. Raises `ProtocolError` if it is not the only one."""
        (answer,) = self.answers(self.frame(word, *arguments), seconds)
        if answer.sequence != self.sequence:
            raise ProtocolError(f"answer {answer.sequence} to request {self.sequence}")
        return reply_of(answer)

    def answers(self, data: bytes, seconds: float = 0.01) -> list[Frame]:
        """Send bytes, advance by `seconds`, return every frame received."""
        self.emulator.send(data)
        self.emulator.drain(seconds)
        return [decode(line) for line in self.emulator.received().splitlines(keepends=True)]

    def state(self) -> StateReply:
        """Return the state without a heartbeat."""
        return self._state("STATE", 0.01)

    def beat(self, seconds: float) -> StateReply:
        """Advance by `seconds` with a heartbeat every 0.1 s; return the last state."""
        for _ in range(max(1, round(seconds / BEAT_TIME)) - 1):
            self.request("BEAT", seconds=BEAT_TIME)
        return self._state("BEAT", BEAT_TIME)

    def make_ready(self) -> StateReply:
        """Identify, arm and home. Raises `ProtocolError` if the board ends up anywhere but at rest and homed."""
        for word in ("ID", "ARM", "HOME"):
            self.request(word)
        for _ in range(100):
            state = self.beat(BEAT_TIME)
            if state.homed:
                return state
        raise ProtocolError(f"homing did not end: {state}")

    def _state(self, word: str, seconds: float) -> StateReply:
        reply = self.request(word, seconds=seconds)
        if not isinstance(reply, StateReply):
            raise ProtocolError(f"{word} was refused: {reply}")
        return reply
