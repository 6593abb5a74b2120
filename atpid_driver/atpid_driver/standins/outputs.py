# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a stand-in device puts out: a memory-mapped file that the library writes and others read.

The device goes on without the process that used it, as a real one does: an output keeps its voltage, a stream that gets
no more samples repeats its last one, and the watchdog acts by the time since it was fed. A device that it resets has
0 V at both outputs while it restarts, then their voltages at power-up. Layout: `Output` of data/standin.h, and from
byte 4096 the queue of streamed samples.
"""

import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MAGIC = b"ATPIDOU2"
QUEUE, DATA_OFFSET = 65536, 4096
HEADER = np.dtype([
    ("magic", "S8"), ("watchdog", "<u4"), ("watchdog_s", "<u4"), ("watchdog_startup_s", "<u4"),
    ("watchdog_strict", "<u4"), ("watchdog_key", "<u4"), ("watchdog_resets", "<u4"), ("watchdog_sets", "<u4", (2,)),
    ("watchdog_volts", "<f8", (2,)), ("power_up", "<f8", (2,)), ("flash", "<u4"), ("booted", "<u4"),
    ("streams", "<u4"), ("target", "<u4"), ("volts", "<f8", (2,)), ("fed_ns", "<i8"), ("rate", "<f8"),
    ("start_ns", "<i8"), ("written", "<u8"),
])  # fmt: skip
RESTART = 0.1  # of the device [s]


class Outputs:
    """Reads the outputs of one device."""

    def __init__(self, path: Path) -> None:
        """Open the file, or make that of a device that has just been switched on."""
        if not path.exists():
            part = path.with_name(f"{path.name}.{os.getpid()}.part")
            part.write_bytes(MAGIC + bytes(DATA_OFFSET - len(MAGIC) + 8 * QUEUE))
            os.replace(part, path)
        self._header = np.memmap(path, HEADER, "r", shape=(1,))[0]
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
            restarts = since % (int(header["watchdog_startup_s"]) or period) < RESTART
            return 0.0 if restarts else float(header["power_up"][output])
        if header["streams"] and header["target"] == output and header["written"]:
            sample = int((now - int(header["start_ns"])) * 1e-9 * float(header["rate"]))
            return float(self._queue[max(0, min(sample, int(header["written"]) - 1)) % QUEUE])
        if expired and header["watchdog_sets"][output]:
            return float(header["watchdog_volts"][output])
        return float(header["volts"][output])
