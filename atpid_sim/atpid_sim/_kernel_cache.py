# SPDX-License-Identifier: Apache-2.0
"""A cache of compiled kernels that a changed source can never meet.

numba keys a cached kernel on its own file only, not on the files of the kernels it calls: after an update of one file
the others would go on running the old code. So the cache gets a folder named after the sources of all kernels.
"""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

from atpid_common.cache import cache_root

_HERE = Path(__file__).parent
_KERNELS = ("engine", "contact", "baselines")
_SHARED = ("kernel.py", "outcome.py", "system.py")


def use_own_cache() -> None:
    """Point numba at the cache folder of these sources, unless NUMBA_CACHE_DIR says otherwise."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    folder = str(cache_root() / f"kernels-{sources_digest()}")
    os.environ["NUMBA_CACHE_DIR"] = folder
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = folder


def sources_digest() -> str:
    """Return 16 hex digits of the sources of all kernels."""
    digest = hashlib.sha256()
    files = [path for name in _KERNELS for path in (_HERE / name).glob("*.py")]
    for path in sorted([*files, *(_HERE / name for name in _SHARED)]):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
