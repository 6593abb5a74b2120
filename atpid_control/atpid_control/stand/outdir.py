# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The output folder: the newest run at its top, older ones in folders of their own; nothing is deleted."""

import hashlib
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from atpid_common import middleware
from atpid_common.output import writing
from atpid_control.stand.parameters import BenchError

#: Written first: marks a folder of the bench.
MARKER = "bench.json"


@contextmanager
def of_run(out: Path, source: Path) -> Iterator[None]:
    """Claim `out`, prepare it and mark it as that of the run of `source`; where an earlier run went is printed."""
    with claimed(out):
        moved = prepare(out)
        with writing(out):
            mark(out, source)
        if moved:
            print(f"an earlier run was moved to {moved}", file=sys.stderr)
        yield


@contextmanager
def claimed(out: Path) -> Iterator[None]:
    """Lock the folder against other benches of this machine; raise BenchError where one runs there."""
    holder = middleware.claimed(f"bench/out/{hashlib.sha256(str(out.resolve()).encode()).hexdigest()}")
    if holder is None:
        raise BenchError(f"--out: given {out}, where another bench is running; give another folder")
    with holder:
        yield


def prepare(out: Path) -> Path | None:
    """Make `out` ready for a run; return where an earlier run of the bench was moved to, if there was one.

    Raises BenchError where `out` is not a folder, cannot be written, or holds files the bench did not write.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        moved = _move_earlier(out)
        (out / "log").mkdir(exist_ok=True)
    except OSError as error:
        raise BenchError(f"--out: given {out}: {error.strerror}; give a folder that can be written") from None
    return moved


def mark(out: Path, scene: Path) -> None:
    """Mark the files and folders at the top of `out` as those of the run of `scene` that begins now."""
    (out / MARKER).write_text(json.dumps({"scene": str(scene), "layout": 1}) + "\n", encoding="utf-8")


def _move_earlier(out: Path) -> Path | None:
    present = [item for item in out.iterdir() if not _is_earlier_run(item)]
    if not present:
        return None
    if not (out / MARKER).is_file():
        names = ", ".join(sorted(item.name for item in present)[:3])
        raise BenchError(
            f"--out: given {out}, which holds files that are not the bench's ({names}); give an empty or a new folder"
        )
    number = 1 + max((int(item.name[4:]) for item in out.iterdir() if _is_earlier_run(item)), default=0)
    target = out / f"run-{number:04d}"
    target.mkdir()
    for item in present:
        item.rename(target / item.name)
    return target


def _is_earlier_run(item: Path) -> bool:
    return item.is_dir() and item.name.startswith("run-") and item.name[4:].isdigit()
