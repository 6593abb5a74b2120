# SPDX-License-Identifier: Apache-2.0
"""The motion of one mass on spring and damper whose support moves: x'' + 2 d x' + w^2 x = w^2 u + 2 d u' (Eq. 3.42)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


def free_columns(count: int, step: float, stiffness: float, damping: float) -> Array:
    """Return the two free motions and a constant (3, n): from any initial state, about any rest position.

    `stiffness` and `damping` are k/m [1/s^2] and c/m [1/s], `step` in [s]. The beam must be underdamped.
    """
    t = np.arange(count) * step
    envelope, omega = np.exp(-0.5 * damping * t), damped_frequency(stiffness, damping)
    return np.stack([envelope * np.cos(omega * t), envelope * np.sin(omega * t), np.ones(count)])


def forced(support: Array, step: float, stiffness: float, damping: float) -> Array:
    """Return the beam's motion (n,) [m] from rest under the support's (n,) [m], straight between its samples.

    The difference equation is exact for such an input (first-order hold), so no step size enters.
    """
    numerator, denominator = _difference_equation(step, stiffness, damping)
    return np.asarray(lfilter(numerator, denominator, support - support[0]), dtype=np.float64)


def damped_frequency(stiffness: float, damping: float) -> float:
    """Return the angular frequency of the decay [rad/s]; NaN where the beam is not underdamped."""
    square = stiffness - 0.25 * damping * damping
    return math.sqrt(square) if square > 0.0 else math.nan


def _difference_equation(step: float, stiffness: float, damping: float) -> tuple[Array, Array]:
    """Return numerator and denominator of the first-order-hold equivalent of (k + c s) / (s^2 + c s + k) for m = 1.

    With H(s)/s^2 expanded in partial fractions 1/s^2 + free motion, its samples' z transform times (1 - z)^2/(z T).
    """
    omega, half = damped_frequency(stiffness, damping), 0.5 * damping
    decay = math.exp(-half * step)
    turn_cos, turn_sin = decay * math.cos(omega * step), decay * math.sin(omega * step)
    denominator = np.array([1.0, -2.0 * turn_cos, decay * decay])
    # ramp response of H: r(t) = t - exp(-d t) sin(w t) / w: both the ramp and the free part start at 0
    first, second = step - turn_sin / omega, 2.0 * step - 2.0 * turn_cos * turn_sin / omega
    third = 3.0 * step - (turn_cos * 2.0 * turn_cos * turn_sin + turn_sin * (turn_cos**2 - turn_sin**2)) / omega
    ramp = np.array([0.0, first, second, third])
    # the numerator is what makes the difference equation answer a unit ramp with these samples
    series = np.convolve(np.convolve(denominator, [1.0, -2.0, 1.0]), ramp)[1:4] / step
    return series, denominator
