# SPDX-License-Identifier: Apache-2.0
"""The folder in which compiled kernels, device stand-ins and height maps are kept between runs."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path


def cache_root() -> Path:
    """Return the project's folder in the user's cache: `$XDG_CACHE_HOME/atpid`, by default `~/.cache/atpid`."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "atpid"


def content_key(folder: Path, files: Iterable[Path]) -> str:
    """Return 16 hex digits of the files' places in `folder` and their contents, whatever their order."""
    total = hashlib.sha256()
    for path in sorted(files):
        total.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return total.hexdigest()[:16]
