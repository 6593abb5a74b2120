# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The exact optimum of a tuned mass on an undamped beam, which `atpid_design.tuned_mass` is checked by."""

import math

from atpid_design.tuned_mass import Tuning


def exact_undamped(mass_ratio: float) -> tuple[Tuning, float]:
    """Return the exact optimum on an undamped beam and its peak [-].

    Nishihara and Asami, Closed-form solutions to the exact optimizations of dynamic vibration absorbers, J. Vib.
    Acoust. 124, 2002, 576-582.
    """
    mu = mass_ratio
    root = math.sqrt(4.0 + 3.0 * mu)
    frequency = (2.0 / (1.0 + mu)) * math.sqrt(
        2.0 * (16.0 + 23.0 * mu + 9.0 * mu**2 + 2.0 * (2.0 + mu) * root) / (3.0 * (64.0 + 80.0 * mu + 27.0 * mu**2))
    )
    damping = 0.25 * math.sqrt((8.0 + 9.0 * mu - 4.0 * root) / (1.0 + mu)) * frequency
    over = (8.0 + 9.0 * mu) ** 2 * (16.0 + 9.0 * mu) - 128.0 * root**3
    peak = math.sqrt(over / (3.0 * (32.0 + 27.0 * mu))) / (3.0 * mu)
    return Tuning(frequency, damping), peak
