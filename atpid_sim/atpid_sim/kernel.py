# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: cached, without the interpreter's lock, and with IEEE arithmetic.

Every kernel takes one of these decorators. The error model is named in them: a function that names none takes it from
the function that first compiles it, and with Python's error model steps take 2.4 times as long
(docs/decisions/0007-integration.md). With numpy's, a division by zero gives infinity or NaN, which every run reports as
a named outcome. There is no fast-math: error bounds are proven for IEEE operations.
"""

from numba import njit

from atpid_sim import kernel_cache as kernel_cache  # before any kernel is made: where it is kept

kernel = njit(cache=True, nogil=True, error_model="numpy")
#: For what a library calls from Python at every evaluation: releasing the lock each time takes 5 % of a run by odeint.
callback = njit(cache=True, error_model="numpy")
inlined = njit(cache=True, nogil=True, error_model="numpy", inline="always")
