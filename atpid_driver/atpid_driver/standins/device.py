# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stand-in device: its library, compiled once for each version of the source, and the files by which it is driven.

The library reads and writes these memory-mapped files while it runs; all numbers are little-endian.
"""

import mmap
import os
import shutil
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from atpid_common.folders import cache_root, content_key
from atpid_driver import DriverError

_SOURCES = Path(__file__).parent / "data"
LIBRARIES = ("libLabJackM.so", "libnidaqmx.so")


class StandinError(DriverError):
    """The stand-in libraries cannot be built, or one of their files cannot be used."""


def build() -> Path:
    """Return the folder with both libraries, made in the user's cache; StandinError without tools."""
    sources = (path for path in _SOURCES.iterdir() if path.is_file())
    target = cache_root() / "standins" / content_key(_SOURCES, sources)
    if all((target / name).is_file() for name in LIBRARIES):
        return target
    for tool in ("make", "cc"):
        if shutil.which(tool) is None:
            raise StandinError(f"{tool} is missing: the stand-ins need a C compiler (apt install build-essential)")
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target) as made:
        command = ["make", "--silent", "--directory", str(_SOURCES), f"BUILD={made}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise StandinError(f"the stand-in libraries do not compile: {done.stderr.strip().splitlines()[-1]}")
        for name in LIBRARIES:
            os.replace(Path(made) / name, target / name)  # in one step: another process may be loading it
    return target


def environment(libraries: Path, **given: str | Path | None) -> dict[str, str]:
    """Return the variables that make a process find the stand-ins instead of the vendors' libraries.

    given: `source`, `control` and `output` of each device, named as `ljm_source` and `daqmx_control`; empty: none.
    """
    path = os.pathsep.join(part for part in (str(libraries), os.environ.get("LD_LIBRARY_PATH", "")) if part)
    named = {f"ATPID_{name.upper()}": str(value) for name, value in given.items() if value}
    return {"LD_LIBRARY_PATH": path} | named


_CONTROL_MAGIC = b"ATPIDCT1"
SERIAL = 470012345
DATA_OFFSET = 4096  # of frames and samples, after the header
CHANNELS = 16


def _record(fields: str) -> np.dtype[np.void]:
    """Return the layout of a file: name and type of each field, in their order."""
    return np.dtype([(name, kind) for name, kind in map(str.split, fields.split(","))])


#: The file, little-endian; `struct control` of data/standin.h.
_PAGE = _record(
    "magic S8, plugged <u4, unplugs <u4, serial <u4, stalled <u4, drop <u8, fail_code <i4, fail_count <u4, held <u4, "
    f"unused <u4, hold_volts {CHANNELS}<f8, slow <f8, rest V3912"
)


class Control:
    """Injects faults into one device, at once in the process that uses the library."""

    def __init__(self, path: Path, serial: int = SERIAL) -> None:
        """Open the control file, or make one of a healthy, plugged-in device with this serial number."""
        self.path = path
        if not path.exists():
            page = np.zeros(1, _PAGE)
            page["magic"], page["plugged"], page["serial"] = _CONTROL_MAGIC, 1, serial
            part = path.with_name(f"{path.name}.{os.getpid()}.part")
            part.write_bytes(page.tobytes())
            os.replace(part, path)
        with path.open("rb") as file:
            begin, size = file.read(len(_CONTROL_MAGIC)), os.fstat(file.fileno()).st_size
        if begin != _CONTROL_MAGIC or size < _PAGE.itemsize:
            raise StandinError(f"{path} is not a stand-in's control file: remove it or name another")
        self._page = np.memmap(path, _PAGE, "r+", shape=(1,))

    def unplug(self) -> None:
        """Pull the cable: running streams end, and stay ended after it is plugged in again."""
        self._page["unplugs"] += 1
        self._page["plugged"] = 0

    def replug(self) -> None:
        """Plug the cable in."""
        self._page["plugged"] = 1

    def drop(self, scans: int) -> None:
        """Lose this many scans, as after an overrun of the device's buffer."""
        self._page["drop"] += scans

    def stall(self, stalled: bool) -> None:
        """Hold back the transfer to the host while the device goes on sampling."""
        self._page["stalled"] = stalled

    def fail(self, code: int) -> None:
        """Make the next read return this vendor's error."""
        self._page["fail_code"] = code
        self._page["fail_count"] += 1

    def hold(self, channel: int, volts: float) -> None:
        """Make a channel, counted from 0 as it is streamed, give `volts` until `release`: a dead or frozen sensor."""
        self._page["hold_volts"][0, _checked(channel)] = volts
        self._page["held"] |= np.uint32(1 << channel)

    def release(self, channel: int) -> None:
        """Let a channel give its own voltage again."""
        self._page["held"] &= np.uint32(~(1 << _checked(channel)) & 0xFFFFFFFF)

    def slow(self, share: float) -> None:
        """Give the device a clock that loses this share of the time [-]; before a stream starts."""
        self._page["slow"] = share

    def serial(self, number: int) -> None:
        """Swap the device for one with another serial number."""
        self._page["serial"] = number

    def close(self) -> None:
        """Unmap the file; its state stays."""
        del self._page


def _checked(channel: int) -> int:
    if not 0 <= channel < CHANNELS:
        raise StandinError(f"channel {channel}: allowed 0 to {CHANNELS - 1}, in the order they are streamed")
    return channel


FEED_MAGIC = b"ATPIDFD1"
_FEED_HEADER = _record("magic S8, channels <u4, capacity <u4, rate <f8, written <u8")


class Feed:
    """Voltages for a device: a ring of frames that one process writes and the library reads.

    Layout: at 0 `char[8] "ATPIDFD1"`, `uint32 channels`, `uint32 capacity` (frames in the ring), `float64 rate` (frames
    per second), `uint64 written` (frames so far, stored after their data); from byte 4096 `float64[capacity][channels]`
    volts, frame i at row i modulo capacity. The file appears complete, so a device finds either none or a good one.

    A stream sees the frames written after its start; between two frames it interpolates. The feed is the device's
    clock: scan i at rate R lies at frame i * rate / R, so a plant that runs slower or faster takes the device along.
    """

    def __init__(self, path: Path, channels: int, rate: float, capacity: int = 65536) -> None:
        """Make the ring for frames of `channels` volts at `rate` [Hz], `capacity` frames long."""
        if channels < 1 or capacity < 2 or not rate > 0.0:
            raise StandinError(f"feed of {channels} channels, {capacity} frames, {rate} Hz: all must be positive")
        self.path, self.channels, self.rate, self.capacity = path, channels, rate, capacity
        part = path.with_name(f"{path.name}.{os.getpid()}.part")
        try:
            with part.open("x+b") as file:
                file.truncate(DATA_OFFSET + 8 * capacity * channels)
                self._memory = mmap.mmap(file.fileno(), 0)
        except OSError as error:
            raise StandinError(f"feed {path} cannot be made: {error.strerror}") from None
        self._made = os.stat(part)
        header = np.frombuffer(self._memory, _FEED_HEADER, 1)
        header[0] = (FEED_MAGIC, channels, capacity, rate, 0)
        self._written = header["written"]
        ring = np.frombuffer(self._memory, np.float64, capacity * channels, DATA_OFFSET)
        self._ring = ring.reshape(capacity, channels)
        os.replace(part, path)

    @property
    def written(self) -> int:
        """Frames written so far."""
        return int(self._written[0])

    def write(self, volts: NDArray[np.float64]) -> None:
        """Append frames (n, channels) [V]."""
        if volts.ndim != 2 or volts.shape[1] != self.channels:
            raise StandinError(f"feed takes frames of {self.channels} volts, it was given {volts.shape}")
        end = self.written + len(volts)
        kept = volts[-self.capacity :]
        self._ring[np.arange(end - len(kept), end) % self.capacity] = kept
        self._written[0] = end

    def close(self) -> None:
        """Unmap and remove the file; a stream that still reads it keeps what it has."""
        self._written = self._ring = np.empty(0)  # type: ignore[assignment]
        self._memory.close()
        with suppress(OSError):
            if os.path.samestat(self._made, os.stat(self.path)):  # another file of this name stays
                self.path.unlink()


_OUTPUT_MAGIC = b"ATPIDOU2"
QUEUE = 65536
OUTPUT_HEADER = _record(
    "magic S8, watchdog <u4, watchdog_s <u4, watchdog_startup_s <u4, watchdog_strict <u4, watchdog_key <u4, "
    "watchdog_resets <u4, watchdog_sets 2<u4, watchdog_volts 2<f8, power_up 2<f8, flash <u4, booted <u4, streams <u4, "
    "target <u4, volts 2<f8, fed_ns <i8, rate <f8, start_ns <i8, written <u8"
)
_RESTART = 0.1  # of the device [s]


class Outputs:
    """Reads what a device puts out, which the library writes: `Output` of data/standin.h, then the streamed samples.

    The device goes on without the process that used it, as a real one does: an output keeps its voltage, a stream that
    gets no more samples repeats its last one, and the watchdog acts by the time since it was fed. A device that it
    resets has 0 V at both outputs while it restarts, then their voltages at power-up.
    """

    def __init__(self, path: Path) -> None:
        """Open the file, or make that of a device that has just been switched on."""
        if not path.exists():
            part = path.with_name(f"{path.name}.{os.getpid()}.part")
            part.write_bytes(_OUTPUT_MAGIC + bytes(DATA_OFFSET - len(_OUTPUT_MAGIC) + 8 * QUEUE))
            os.replace(part, path)
        self._header = np.memmap(path, OUTPUT_HEADER, "r", shape=(1,))[0]
        self._queue = np.memmap(path, np.float64, "r", offset=DATA_OFFSET, shape=(QUEUE,))

    def recent(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times before now (n,) [s] and the voltages between the outputs there (n,), one a millisecond."""
        now, age = time.monotonic_ns(), 1e-3 * np.arange(round(1e3 * seconds), dtype=np.float64)
        return -age, np.array([self.between(now - round(1e9 * each)) for each in age])

    def between(self, now_ns: int | None = None) -> float:
        """Return the voltage of DAC0 over DAC1, which a differential input sees, at a steady time [ns] [V]."""
        now = time.monotonic_ns() if now_ns is None else now_ns
        return self.volts(0, now) - self.volts(1, now)

    def volts(self, output: int, now_ns: int | None = None) -> float:
        """Return the voltage of DAC`output` at a steady time [ns], by default now [V]."""
        now, header = time.monotonic_ns() if now_ns is None else now_ns, self._header
        period = int(header["watchdog_startup_s" if header["booted"] else "watchdog_s"])
        since = (now - int(header["fed_ns"])) * 1e-9 - period
        expired = header["watchdog"] and since > 0.0
        if expired and header["watchdog_resets"]:
            restarts = since % (int(header["watchdog_startup_s"]) or period) < _RESTART
            return 0.0 if restarts else float(header["power_up"][output])
        if header["streams"] and header["target"] == output and header["written"]:
            sample = int((now - int(header["start_ns"])) * 1e-9 * float(header["rate"]))
            return float(self._queue[max(0, min(sample, int(header["written"]) - 1)) % QUEUE])
        if expired and header["watchdog_sets"][output]:
            return float(header["watchdog_volts"][output])
        return float(header["volts"][output])
