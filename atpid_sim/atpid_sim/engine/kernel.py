# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: cached, without the interpreter's lock, and with IEEE arithmetic.

A division by zero then gives infinity or NaN, which every rung reports as a named outcome, instead of an exception out
of the middle of a step. No fast-math: error bounds are proven for IEEE operations.
"""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, nogil=True, error_model="numpy")
inlined = njit(cache=True, nogil=True, error_model="numpy", inline="always")
