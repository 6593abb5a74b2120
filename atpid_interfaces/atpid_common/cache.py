# SPDX-License-Identifier: Apache-2.0
"""The folder in which compiled kernels, device stand-ins and height maps are kept between runs."""

from __future__ import annotations

import os
from pathlib import Path


def cache_root() -> Path:
    """Return the project's folder in the user's cache: `$XDG_CACHE_HOME/atpid`, by default `~/.cache/atpid`."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "atpid"
