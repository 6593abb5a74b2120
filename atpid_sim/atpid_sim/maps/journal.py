# SPDX-License-Identifier: Apache-2.0
"""The journal of a map being made: one line a point, on the disk before the next; nothing is computed twice."""

import fcntl
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from atpid_sim.maps.height_map import MapError

#: Where a point lies; of a map: mass fraction [-], amplitude [m].
Point = tuple[float, ...]


#: Size of a journal at most [bytes]: a map of 100 000 amplitudes has 30 MB.
_MOST_BYTES = 500_000_000


class Journal:
    """A file beside the map. Its first line identifies system and settings; an incomplete last line is dropped."""

    def __init__(self, out: Path, purpose: Mapping[str, Any]) -> None:
        """Open or begin the journal of the map `out`; raise MapError where it is another's or in use."""
        self.path = out.with_name(out.name + ".journal")
        self.points: dict[Point, dict[str, Any]] = {}
        try:
            self._file = self.path.open("a+b")
        except OSError as error:
            raise MapError(f"{self.path}: cannot be written: {error.strerror}; choose another --out") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._resume(dict(purpose))
        except OSError:
            self.close()
            problem = f"{self.path}: another run is making this map"
            raise MapError(f"{problem}; wait for it or choose another --out") from None
        except MapError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file, which stays for the next attempt unless `finish` was called."""
        self._file.close()

    def record(self, point: Point, values: Mapping[str, Any]) -> None:
        """Put one point on the disk."""
        self._append({"point": list(point), **values})

    def finish(self) -> None:
        """Remove the journal: the map is written."""
        self.path.unlink(missing_ok=True)

    def _resume(self, purpose: dict[str, Any]) -> None:
        self._file.seek(0)
        if os.fstat(self._file.fileno()).st_size > _MOST_BYTES:
            raise MapError(f"{self.path}: is not the journal of a map; remove it or choose another --out")
        whole = self._file.read().rpartition(b"\n")[0]
        lines = whole.splitlines()
        try:
            first, rest = (json.loads(lines[0]), [_point(line) for line in lines[1:]]) if lines else (None, [])
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise MapError(f"{self.path}: is not the journal of a map; remove it or choose another --out") from None
        if lines and first != json.loads(json.dumps(purpose)):
            raise MapError(f"{self.path}: begun for another system or tolerance; remove it or choose another --out")
        self._file.truncate(len(whole) + 1 if whole else 0)  # only now: until here it may be another's file
        self.points.update(rest)
        if not lines:
            self._append(purpose)

    def _append(self, line: Mapping[str, Any]) -> None:
        try:
            self._file.write(json.dumps(line).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):  # without another attempt to write what is buffered
                self.close()
            raise MapError(
                f"{self.path}: cannot be written: {error.strerror}; make room and give the same command: it goes on "
                "from the points that are in it"
            ) from None


def _point(line: bytes) -> tuple[Point, dict[str, Any]]:
    """Return a point and what was computed there; raise ValueError, TypeError or KeyError for another line."""
    values = dict(json.loads(line))
    return tuple(float(value) for value in values.pop("point")), values
