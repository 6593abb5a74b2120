# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults for a stand-in device, through a small memory-mapped file that the library reads while it runs."""

import os
from pathlib import Path

import numpy as np

from atpid_driver.standins.build import StandinError

MAGIC = b"ATPIDCT1"
SERIAL = 470012345
CHANNELS = 16
#: The file, little-endian; `struct control` of data/standin.h.
PAGE = np.dtype([
    ("magic", "S8"), ("plugged", "<u4"), ("unplugs", "<u4"), ("serial", "<u4"), ("stalled", "<u4"), ("drop", "<u8"),
    ("fail_code", "<i4"), ("fail_count", "<u4"), ("held", "<u4"), ("unused", "<u4"), ("hold_volts", "<f8", (CHANNELS,)),
    ("slow", "<f8"), ("rest", "V3912"),
])  # fmt: skip


class Control:
    """Injects faults into one device, at once in the process that uses the library."""

    def __init__(self, path: Path, serial: int = SERIAL) -> None:
        """Open the control file, or make one of a healthy, plugged-in device with this serial number."""
        self.path = path
        if not path.exists():
            page = np.zeros(1, PAGE)
            page["magic"], page["plugged"], page["serial"] = MAGIC, 1, serial
            part = path.with_name(f"{path.name}.{os.getpid()}.part")
            part.write_bytes(page.tobytes())
            os.replace(part, path)
        with path.open("rb") as file:
            begin, size = file.read(len(MAGIC)), os.fstat(file.fileno()).st_size
        if begin != MAGIC or size < PAGE.itemsize:
            raise StandinError(f"{path} is not a stand-in's control file: remove it or name another")
        self._page = np.memmap(path, PAGE, "r+", shape=(1,))

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
