# SPDX-License-Identifier: Apache-2.0
"""Hard contact: an instantaneous exchange of momentum with constant restitution (equations 3.1-3.7).

Parameters: (restitution [-],). There is no force to integrate: only the `impact` rung takes this law, and a rung that
asks it for a force is answered with NaN, which every stepper reports as a named failure.
"""

from __future__ import annotations

import math

from numba import njit

DESCRIPTION = "hard contact, an instantaneous impact with constant restitution (Eqs 3.1-3.7)"


@njit(cache=True, error_model="numpy")
def force(overlap, rate, memory, p):  # type: ignore[no-untyped-def]
    """NaN: an instantaneous impact has no force."""
    return math.nan


@njit(cache=True, error_model="numpy")
def release_rate(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Infinite: the grain lets go at once."""
    return math.inf


@njit(cache=True, error_model="numpy")
def energy(overlap, memory, p):  # type: ignore[no-untyped-def]
    """Zero: nothing is stored."""
    return 0.0


@njit(cache=True, error_model="numpy")
def restitution(speed, mass, p):  # type: ignore[no-untyped-def]
    """The parameter itself, at every speed."""
    return p[0]


@njit(cache=True, error_model="numpy")
def velocities_after(first_mass, second_mass, first, second, e):  # type: ignore[no-untyped-def]
    """Velocities (first, second) [m/s] after an impact with restitution e (equations 3.6 and 3.7)."""
    common = (first_mass * first + second_mass * second) / (first_mass + second_mass)
    return common + e * (common - first), common + e * (common - second)
