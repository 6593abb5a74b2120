# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a study writes its page: never over a text that no study has made."""

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
