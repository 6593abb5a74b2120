# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A vibro-impact energy sink under a harmonic force in closed form, to first order in its share of the mass.

An oscillator of mass 1 - eps, stiffness 1 and damping 2 D carries a grain of mass eps without weight between walls a
clearance of 2 g apart. In the motion of two impacts a cycle the grain's path is a triangle of amplitude theta g; that
of the oscillator is a tone of amplitude xi g. Both follow the slow invariant manifold, which begins at
xi = rho / sqrt(1 + rho^2): below that amplitude the sink is not active. Equations of Weidemann, Bergman, Vakakis and
Krack (Nonlinear Dyn. 2025, doi 10.1007/s11071-025-10928-4), for one oscillator; their example has eps = 0.02,
D = 0.001 and a restitution of 0.8.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

#: Points at which roots are looked for, and the largest amplitude over half the clearance.
_POINTS, _LARGEST = 4000, 20.0


@dataclass(frozen=True)
class ImpactSink:
    """The system, dimensionless; clearances over the resonance's amplitude 1 / (2 D) with the grain held."""

    mass_share: float  # eps
    damping_ratio: float  # D
    restitution: float

    @property
    def rho(self) -> float:
        """Slope of the manifold's dissipation."""
        return 2.0 / math.pi * (1.0 - self.restitution) / (1.0 + self.restitution)

    @property
    def threshold(self) -> float:
        """Least amplitude of the oscillator over half the clearance at which the sink is active."""
        return self.rho / math.hypot(1.0, self.rho)

    def clearance(self, xi: float, ratio: float) -> float:
        """Return half the clearance at which the amplitude is xi of it; ratio: of the frequency to the closed one."""
        rho, eps = self.rho, self.mass_share
        theta = (1.0 + math.sqrt((1.0 + rho**2) * xi**2 - rho**2)) / (1.0 + rho**2)
        turn = complex(theta - 1.0, -rho * theta) / xi
        linear = complex(1.0 - (1.0 - eps) * ratio**2, 2.0 * self.damping_ratio * ratio)
        return 2.0 * self.damping_ratio / abs(linear * xi - 8.0 * eps * theta * turn * ratio**2 / math.pi**2)

    def amplitudes(self, clearance: float, ratio: float) -> list[float]:
        """Return the amplitudes of motions of two impacts a cycle, over half the clearance, rising."""

        def excess(xi: float) -> float:
            return self.clearance(xi, ratio) - clearance

        points = np.geomspace(self.threshold * (1.0 + 1e-9), _LARGEST, _POINTS)
        signs = np.sign([excess(xi) for xi in points])
        return [float(brentq(excess, points[k], points[k + 1])) for k in np.flatnonzero(signs[1:] != signs[:-1])]
