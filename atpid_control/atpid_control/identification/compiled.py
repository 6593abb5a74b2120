# SPDX-License-Identifier: Apache-2.0
"""numba's compiler behind one typed name, with the cache of `atpid_sim.kernel_cache`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

from atpid_sim.kernel_cache import share_cache

#: The modules with compiled functions.
KERNELS = ("choice", "columns", "covariance", "linear", "sine_fit")

F = TypeVar("F", bound=Callable[..., object])

share_cache("identification", (Path(__file__).parent / f"{name}.py" for name in (*KERNELS, "compiled")))


def compiled(function: F) -> F:
    """Compile `function` to machine code, kept in the cache; sums may be reordered so that they vectorise."""
    return cast(F, numba.njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})(function))
