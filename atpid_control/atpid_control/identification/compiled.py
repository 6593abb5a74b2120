# SPDX-License-Identifier: Apache-2.0
"""numba's compiler behind one typed name, with a cache that a changed source can never meet.

numba keys a cached function on its own file only, not on the files of the functions it calls. So the cache's folder is
named after the sources of all of them.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

from atpid_common.cache import cache_root

#: The modules with compiled functions.
KERNELS = ("choice", "columns", "covariance", "linear", "sine_fit")

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile `function` to machine code, kept in the cache; sums may be reordered so that they vectorise."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        return cast(F, numba.njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})(function))
    finally:
        numba.config.CACHE_DIR = before


def _folder() -> str:
    """Return the cache's folder: where numba was told to keep its own, else the user's cache."""
    digest = hashlib.sha256()
    for name in (*KERNELS, "compiled"):
        digest.update(name.encode() + (Path(__file__).parent / f"{name}.py").read_bytes())
    root = os.environ.get("NUMBA_CACHE_DIR") or cache_root()
    return str(Path(root) / f"identification-{digest.hexdigest()[:16]}")


_FOLDER = _folder()
