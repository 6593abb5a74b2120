# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a study writes its page: never over a text that no study has made."""

import os
from pathlib import Path

from atpid_common.output import OutputError, file

#: What the pages of the studies hold, and a user's own text does not.
_MADE = b"python -m studies"


def to_write(path: Path) -> Path:
    """Return the path of a page to write; raise OutputError where another text than one of ours is there."""
    file(path, "--page")
    if path.exists() and _MADE not in path.read_bytes():
        raise OutputError(f"{path}: exists already and is no page made by a command; give another file to --page")
    return path


def figures(page: Path) -> Path:
    """Return the folder of a page's pictures: `figures` beside it, or above it where only that exists."""
    beside, above = page.parent / "figures", page.parent.parent / "figures"
    return above if above.is_dir() and not beside.is_dir() else beside


def link(page: Path) -> str:
    """Return the folder of a page's pictures as the page links to it."""
    return Path(os.path.relpath(figures(page), page.parent)).as_posix()
