# SPDX-License-Identifier: Apache-2.0
"""Simulation against measurement: lag and offset by a stated rule, then the relative error (Eq. 3.46).

The thesis divides by the measured X_Exp, which its list of symbols calls an amplitude: a displacement passes zero in
every period. So amplitudes of whole periods are compared, half the range in each, in which no offset is left and a lag
of less than a period changes little.
"""

import numpy as np

from atpid_sim.system import Array


def lag_of(measured: Array, simulated: Array, most: int) -> int:
    """Return by how many samples a measurement (n,) is later than its simulation (n,): the best correlation.

    Looked for from -most to most samples; both are taken without their means.
    """
    one, other = measured - measured.mean(), simulated - simulated.mean()
    size = len(one)

    def correlation(lag: int) -> float:
        return float(one[max(lag, 0) : size + min(lag, 0)] @ other[max(-lag, 0) : size - max(lag, 0)])

    return max(range(-most, most + 1), key=correlation)


def aligned(measured: Array, simulated: Array, lag: int) -> tuple[Array, Array]:
    """Return both series (k,) [m] over their common time, the lag [samples] and the offset removed."""
    size = len(measured)
    one, other = measured[max(lag, 0) : size + min(lag, 0)], simulated[max(-lag, 0) : size - max(lag, 0)]
    return one - one.mean() + other.mean(), other


def relative_rmse(experiment: Array, simulation: Array) -> float:
    """Return the root mean square of (X_Exp - X_Sim) / X_Exp [-] over the amplitudes of whole periods (Eq. 3.46).

    experiment, simulation: (k,) [m], as `analysis.damping.amplitudes_per_period` gives them.
    """
    return float(np.sqrt(np.mean(((experiment - simulation) / experiment) ** 2)))
