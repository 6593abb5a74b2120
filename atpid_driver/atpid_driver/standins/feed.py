# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Voltages for a stand-in device: a memory-mapped ring of frames that one process writes and the library reads.

Layout, little-endian: at 0 `char[8] "ATPIDFD1"`, `uint32 channels`, `uint32 capacity` (frames in the ring),
`float64 rate` (frames per second), `uint64 written` (frames so far, stored after their data); from byte 4096
`float64[capacity][channels]` volts, frame i at row i modulo capacity.

A stream sees the frames written after its start; between two frames it interpolates. The feed is the device's clock:
scan i at rate R lies at frame i * rate / R, so that a plant that runs slower or faster takes the device along.
"""

import mmap
import os
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from atpid_driver.standins.build import StandinError

MAGIC = b"ATPIDFD1"
HEADER = np.dtype([("magic", "S8"), ("channels", "<u4"), ("capacity", "<u4"), ("rate", "<f8"), ("written", "<u8")])
DATA_OFFSET = 4096


class Feed:
    """Writes frames of voltages; the file appears complete, so a device finds either none or a good one."""

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
        header = np.frombuffer(self._memory, HEADER, 1)
        header[0] = (MAGIC, channels, capacity, rate, 0)
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
