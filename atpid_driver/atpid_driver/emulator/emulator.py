# SPDX-License-Identifier: Apache-2.0
"""The emulator as a context manager: start, run, inject faults, read the state, end."""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from atpid_common.errors import InputError
from atpid_driver.emulator.build import build_emulator, build_firmware


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
    restart,
    `reset_on_open` whether opening the port restarts the board, as on a real one.
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
        """Start it. Raises `EmulatorUnavailableError` where it cannot be built."""
        self.link = link
        arguments = [str(build_emulator()), str(firmware or build_firmware()), "--link", str(link)]
        arguments += ["--height", f"{height * 1e6:.1f}", "--bootloader", f"{bootloader * 1e3:.3f}"]
        arguments += ["--eeprom", str(eeprom)] if eeprom else []
        arguments += ["--reset-on-open"] if reset_on_open else []
        self._process = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        self._expect("ready")

    def __enter__(self) -> Emulator:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Power off and end."""
        self.close()

    def run(self, seconds: float) -> None:
        """Advance simulated time by `seconds`, as fast as this machine can."""
        self._do(f"run {seconds * 1e3:.3f}")

    def drain(self, seconds: float = 0.0) -> None:
        """Run until the board has received all that was sent, then for `seconds`."""
        self._do(f"drain {seconds * 1e3:.3f}")

    def pace(self, factor: float) -> None:
        """Run at `factor` times real time; 0: stop, as a board that hangs."""
        self._do(f"pace {factor}")

    def set(self, name: str, value: str | int | float) -> None:
        """Inject or clear a fault of the stand: see data/stand.h for names and values."""
        self._do(f"set {name} {value}")

    def reset(self) -> None:
        """Press the reset button."""
        self._do("reset")

    def hang(self) -> None:
        """Make the firmware's main program hang, which its watchdog must detect."""
        self._do("hang")

    def power(self, on: bool) -> None:
        """Switch the board's supply."""
        self._do(f"power {int(on)}")

    def unplug(self) -> None:
        """Pull the USB cable: the port disappears."""
        self._do("unplug")

    def plug(self) -> None:
        """Plug it in: the port appears again under the same name."""
        self._do("plug")

    def send(self, data: bytes) -> None:
        """Send bytes straight to the board; use it without a host at the port."""
        for start in range(0, len(data), 30_000):
            self._do(f"send {data[start : start + 30_000].hex()}")

    def received(self) -> bytes:
        """Return what the board sent since the last call; empty while a host has the port."""
        return bytes.fromhex(self._exchange("recv"))

    def exchange(self, data: bytes, seconds: float = 0.01) -> bytes:
        """Send, wait until the board has received it, advance by `seconds`, return its answers."""
        self.send(data)
        self.drain(seconds)
        return self.received()

    def state(self) -> StandState:
        """Return the true state of the stand."""
        values = json.loads(self._exchange("state"))
        return StandState(**values | {"open": bool(values["open"])})

    def command(self, line: str) -> str:
        """Send a line to the emulator as it is and return its answer (data/emulator.c lists the commands)."""
        return self._exchange(line)

    def close(self) -> None:
        """Power off and end."""
        if self._process.poll() is None and self._process.stdin is not None:
            self._process.stdin.close()
            self._process.wait(timeout=10)
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()

    def _do(self, command: str) -> None:
        answer = self._exchange(command)
        if answer != "ok":
            raise EmulatorError(f"emulator: {command[:60]}: {answer}")

    def _exchange(self, command: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _expect(self, word: str) -> None:
        answer = self._answer()
        if answer != word:
            self.close()
            raise EmulatorError(f"emulator did not start: {answer!r}")

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise EmulatorError(f"emulator ended with status {self._process.wait(timeout=10)}")
        return line.rstrip("\n")
