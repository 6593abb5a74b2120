# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The journal of a batch: one line a job, on the disk before the next; nothing is computed twice."""

import fcntl
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from atpid_common.errors import InputError

Job = TypeVar("Job")
Answer = TypeVar("Answer")
#: Which job it is, in numbers and words; of a map: mass fraction [-], amplitude [m].
Point = tuple[Any, ...]

#: Size of a journal at most [bytes]: a map of 100 000 amplitudes has 30 MB.
_MOST_BYTES = 500_000_000


class JournalError(InputError):
    """A journal that cannot be used; one line."""


@dataclass(frozen=True)
class Record(Generic[Job, Answer]):
    """What a batch keeps of its answers, and where."""

    path: Path
    purpose: Mapping[str, Any]  # first line of the file: another system or other settings are refused
    key: Callable[[Job], Point]
    plain: Callable[[Answer], Mapping[str, Any]]  # to what JSON has
    back: Callable[[Mapping[str, Any]], Answer]

    def finish(self) -> None:
        """Remove the journal: what the answers are for is written."""
        self.path.unlink(missing_ok=True)


def beside(out: Path) -> Path:
    """Return the journal's file for an output file."""
    return out.with_name(out.name + ".journal")


class Journal:
    """A file whose first line identifies system and settings; an incomplete last line is dropped."""

    def __init__(self, path: Path, purpose: Mapping[str, Any]) -> None:
        """Open or begin a journal; raise JournalError where it is another's, in use or cannot be written."""
        self.path = path
        self.points: dict[Point, dict[str, Any]] = {}
        try:
            self._file = self.path.open("a+b")
        except OSError as error:
            raise JournalError(f"{self.path}: cannot be written: {error.strerror}; choose another --out") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._resume(dict(purpose))
        except OSError:
            self.close()
            problem = f"{self.path}: another run is writing it"
            raise JournalError(f"{problem}; wait for it or choose another --out") from None
        except JournalError:
            self.close()
            raise

    def close(self) -> None:
        """Close the file, which stays for the next attempt."""
        self._file.close()

    def record(self, point: Point, values: Mapping[str, Any]) -> None:
        """Put one answer on the disk."""
        self._append({"point": list(point), **values})

    def _resume(self, purpose: dict[str, Any]) -> None:
        self._file.seek(0)
        if os.fstat(self._file.fileno()).st_size > _MOST_BYTES:
            raise JournalError(f"{self.path}: is no journal of this command; remove it or choose another --out")
        whole = self._file.read().rpartition(b"\n")[0]
        lines = whole.splitlines()
        try:
            first, rest = (json.loads(lines[0]), [_point(line) for line in lines[1:]]) if lines else (None, [])
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            problem = f"{self.path}: is no journal of this command"
            raise JournalError(f"{problem}; remove it or choose another --out") from None
        if lines and first != json.loads(json.dumps(purpose)):
            raise JournalError(f"{self.path}: begun for another system or tolerance; remove it or choose another --out")
        self._file.truncate(len(whole) + 1 if whole else 0)  # only now: until here it may be another's file
        self.points.update(rest)
        if not lines:
            self._append(purpose)

    def _append(self, line: Mapping[str, Any]) -> None:
        try:
            self._file.write(json.dumps(line, default=_plain).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):  # without another attempt to write what is buffered
                self.close()
            raise JournalError(
                f"{self.path}: cannot be written: {error.strerror}; make room and give the same command: it goes on "
                "from what is in it"
            ) from None


def _plain(value: Any) -> Any:
    """Return numbers of numpy as Python's; raise TypeError for what JSON has not."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not for a journal")


def _point(line: bytes) -> tuple[Point, dict[str, Any]]:
    """Return which job a line is of and its answer; raise ValueError, TypeError or KeyError for another line."""
    values = dict(json.loads(line))
    point = values.pop("point")
    return tuple(value if isinstance(value, str) else float(value) for value in point), values
