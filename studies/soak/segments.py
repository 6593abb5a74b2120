# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The shared memory of Fast DDS in /dev/shm, which a node that was killed leaves behind.

Its names are those of the wheels' Fast DDS: a segment `fastrtps_` with 16 hexadecimal digits, a port
`fastrtps_port` with its number, each with its lock files `_el` and `_sl`, and a semaphore a port.
"""

import fcntl
import os
import re
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_NAME = re.compile(r"(?:sem\.)?(fastrtps_(?:[0-9a-f]{16}|port\d+))(?:_el|_sl|_mutex)?")
FOLDER = Path("/dev/shm")  # noqa: S108 - where Fast DDS has it
#: What the names of ports begin with. Runs in all domains use the same ports, and segments of their own.
PORT = "fastrtps_port"
#: Younger files may be in the making [s].
_AGE = 10.0


def present(folder: Path = FOLDER) -> dict[str, list[Path]]:
    """Return the files of this user's segments and ports, by the segment's or port's name."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("*fastrtps_*")):
        name = _NAME.fullmatch(path.name)
        with suppress(OSError):  # removed just now
            if name and path.stat().st_uid == os.getuid():
                found.setdefault(name[1], []).append(path)
    return found


def orphans(folder: Path = FOLDER, age: float = _AGE) -> dict[str, list[Path]]:
    """Return those of `present` that no process has mapped, open or locked.

    age: younger segments, which may be in the making, are left out [s]; young ports always.
    """
    found = present(folder)
    used = set().union(*(used_by(process.name, folder) for process in Path("/proc").glob("[0-9]*")))
    return {
        name: files
        for name, files in found.items()
        if name not in used
        and not any(_young(path, _AGE if name.startswith(PORT) else age) or _locked(path) for path in files)
    }


def clean(folder: Path = FOLDER, age: float = _AGE) -> int:
    """Remove the `orphans`; return how many segments and ports that were."""
    found = orphans(folder, age)
    for files in found.values():
        for path in files:
            path.unlink(missing_ok=True)
    return len(found)


def used_by(process: int | str, folder: Path = FOLDER) -> set[str]:
    """Return the names, as in `present`, of what a process has mapped or open, as far as one may look."""
    names = (_NAME.fullmatch(Path(path).name) for path in _held(Path("/proc") / str(process), f"{folder}/"))
    return {name[1] for name in names if name}


def _held(process: Path, prefix: str) -> Iterator[str]:
    """Yield the files below `prefix` that a process has mapped or open; those removed since too."""
    with suppress(OSError):
        # open files first: what is closed in between has been mapped before
        for handle in os.scandir(process / "fd"):
            with suppress(OSError):
                target = os.readlink(handle.path)
                if target.startswith(prefix):
                    yield target.removesuffix(" (deleted)")
    with suppress(OSError):
        for line in (process / "maps").read_text(errors="replace").splitlines():
            place = line.find(prefix)
            if place >= 0:
                yield line[place:].removesuffix(" (deleted)")


def _young(path: Path, age: float) -> bool:
    try:
        return time.time() - path.stat().st_mtime < age
    except OSError:
        return True


def _locked(path: Path) -> bool:
    """Whether a process, of another container too, holds the lock file."""
    if not path.name.endswith(("_el", "_sl")):
        return False
    try:
        handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(handle)
    return False
