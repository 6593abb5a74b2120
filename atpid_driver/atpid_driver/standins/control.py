# SPDX-License-Identifier: Apache-2.0
"""Faults for a stand-in device, through a small memory-mapped file that the library reads while it runs.

Layout, little-endian, 4096 bytes: `char[8] "ATPIDCT1"`, `uint32 plugged`, `uint32 unplugs`, `uint32 serial`,
`uint32 stalled`, `uint64 drop`, `int32 fail_code`, `uint32 fail_count`.
"""

from __future__ import annotations

import mmap
import os
import struct
from pathlib import Path

from atpid_driver.standins.build import StandinError

MAGIC = b"ATPIDCT1"
SIZE = 4096
SERIAL = 470012345
FIELDS = {
    "plugged": (8, "<I"),
    "unplugs": (12, "<I"),
    "serial": (16, "<I"),
    "stalled": (20, "<I"),
    "drop": (24, "<Q"),
    "fail_code": (32, "<i"),
    "fail_count": (36, "<I"),
}


class Control:
    """Injects faults into one device, at once in the process that uses the library."""

    def __init__(self, path: Path, serial: int = SERIAL) -> None:
        """Open the control file, or make one of a healthy, plugged-in device with this serial number."""
        self.path = path
        if not path.exists():
            self._make(serial)
        with path.open("r+b") as file:
            if len(file.read(SIZE)) < SIZE:
                raise StandinError(f"{path} is not a stand-in's control file: remove it or name another")
            self._memory = mmap.mmap(file.fileno(), SIZE)
        if self._memory[:8] != MAGIC:
            raise StandinError(f"{path} is not a stand-in's control file: remove it or name another")

    def _make(self, serial: int) -> None:
        page = bytearray(SIZE)
        page[:8] = MAGIC
        struct.pack_into("<III", page, 8, 1, 0, serial)
        part = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        part.write_bytes(page)
        os.replace(part, self.path)

    def unplug(self) -> None:
        """Pull the cable: running streams end, and stay ended after it is plugged in again."""
        self._set("unplugs", self._get("unplugs") + 1)
        self._set("plugged", 0)

    def replug(self) -> None:
        """Plug the cable in."""
        self._set("plugged", 1)

    def drop(self, scans: int) -> None:
        """Lose this many scans, as after an overrun of the device's buffer."""
        self._set("drop", self._get("drop") + scans)

    def stall(self, stalled: bool) -> None:
        """Hold back the transfer to the host while the device goes on sampling."""
        self._set("stalled", int(stalled))

    def fail(self, code: int) -> None:
        """Make the next read return this vendor's error."""
        self._set("fail_code", code)
        self._set("fail_count", self._get("fail_count") + 1)

    def serial(self, number: int) -> None:
        """Swap the device for one with another serial number."""
        self._set("serial", number)

    def close(self) -> None:
        """Unmap the file; its state stays."""
        self._memory.close()

    def _get(self, name: str) -> int:
        offset, kind = FIELDS[name]
        return int(struct.unpack_from(kind, self._memory, offset)[0])

    def _set(self, name: str, value: float) -> None:
        offset, kind = FIELDS[name]
        struct.pack_into(kind, self._memory, offset, value)
