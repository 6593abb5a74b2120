# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Least squares on a few columns: normal equations and Cholesky, written out because they are small.

`compiled` is numba's compiler behind one typed name, with the cache of `atpid_sim.kernel`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from atpid_sim.kernel import share_cache
from atpid_sim.system import Array

#: The modules with compiled functions.
KERNELS = ("choice", "columns", "covariance", "linear", "sine_fit")
#: Columns are independent where this share of each is left beside the others [-].
LEAST_PIVOT = 1e-11
F = TypeVar("F", bound=Callable[..., object])

share_cache("identification", (Path(__file__).parent / f"{name}.py" for name in KERNELS))


def compiled(function: F) -> F:
    """Compile `function` to machine code, kept in the cache; sums may be reordered so that they vectorise."""
    return cast(F, numba.njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})(function))


Indices = NDArray[np.int64]


@compiled
def dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors (n,)."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@compiled
def gram(columns: Array, chosen: Indices, matrix: Array) -> None:
    """Write the scalar products of the `chosen` rows of `columns` (p, n) into `matrix` (p, p)."""
    for i in range(chosen.size):
        for j in range(i + 1):
            value = dot(columns[chosen[i]], columns[chosen[j]])
            matrix[chosen[i], chosen[j]] = value
            matrix[chosen[j], chosen[i]] = value


@compiled
def project(columns: Array, chosen: Indices, signal: Array, vector: Array) -> None:
    """Write the scalar products of the `chosen` rows of `columns` (p, n) with `signal` (n,) into `vector` (p,)."""
    for i in range(chosen.size):
        vector[chosen[i]] = dot(columns[chosen[i]], signal)


@compiled
def factor(matrix: Array, chosen: Indices, lower: Array) -> bool:
    """Write the Cholesky factor of matrix[chosen, chosen] into `lower`; False where the columns are not independent."""
    for i in range(chosen.size):
        for j in range(i + 1):
            value = matrix[chosen[i], chosen[j]]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i == j:
                if not value > LEAST_PIVOT * matrix[chosen[i], chosen[i]]:
                    return False
                lower[i, i] = np.sqrt(value)
            else:
                lower[i, j] = value / lower[j, j]
    return True


@compiled
def substitute(lower: Array, count: int, vector: Array) -> None:
    """Solve lower lower' x = vector in place for the first `count` entries."""
    for i in range(count):
        for k in range(i):
            vector[i] -= lower[i, k] * vector[k]
        vector[i] /= lower[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            vector[i] -= lower[k, i] * vector[k]
        vector[i] /= lower[i, i]


@compiled
def least_squares(columns: Array, chosen: Indices, signal: Array) -> tuple[bool, Array, Array]:
    """Return whether the `chosen` rows of `columns` (p, n) are independent, their coefficients (k,), and their factor.

    signal (n,): what they are fitted to; the factor (p, p) is that of the normal equations.
    """
    size = columns.shape[0]
    matrix, vector, lower = np.zeros((size, size)), np.zeros(size), np.zeros((size, size))
    gram(columns, chosen, matrix)
    project(columns, chosen, signal, vector)
    coefficients = np.empty(chosen.size)
    for k in range(chosen.size):
        coefficients[k] = vector[chosen[k]]
    independent = factor(matrix, chosen, lower)
    if independent:
        substitute(lower, chosen.size, coefficients)
    return independent, coefficients, lower


@compiled
def explained(lower: Array, vector: Array, chosen: Indices) -> float:
    """Return the sum of squares that the factored columns explain of a signal with scalar products `vector`."""
    partial = np.empty(chosen.size)
    total = 0.0
    for i in range(chosen.size):
        value = vector[chosen[i]]
        for k in range(i):
            value -= lower[i, k] * partial[k]
        partial[i] = value / lower[i, i]
        total += partial[i] * partial[i]
    return total


@compiled
def inverse_corner(lower: Array, count: int, size: int) -> Array:
    """Return the first `size` rows and columns of the inverse of lower lower' (count, count)."""
    corner = np.empty((size, size))
    for column in range(size):
        unit = np.zeros(count)
        unit[column] = 1.0
        substitute(lower, count, unit)
        for row in range(size):
            corner[row, column] = unit[row]
    return corner
