# SPDX-License-Identifier: Apache-2.0
"""The structures a promise has to hold for: corners of the box of uncertainties, and random ones inside it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.linalg import hadamard

from atpid_control.design.problem import NOMINAL, Deviation, Problem, scene_of
from atpid_sim.kernel_inputs import Contact, contact_of
from atpid_sim.maps import DamperResponse
from atpid_sim.system import Array

#: Columns of the Hadamard matrix of order 16 that are the fractional factorial design 2^(8-4) of resolution IV: eight
#: factors at two levels in 16 runs, main effects clear of each other and of products of two (Box, Hunter and Hunter,
#: Statistics for Experimenters, table 6.22: E = BCD, F = ACD, G = ABC, H = ABD).
_COLUMNS = (1, 2, 4, 8, 14, 13, 7, 11)
#: Relative tolerance of the runs: 0.2 % of an amplitude is resolved.
RTOL = 1e-5


class Case(NamedTuple):
    """A structure, how its support amplitude differs from the identified one, and its ceiling from the command."""

    damper: DamperResponse
    off: Deviation
    contact: Contact

    def amplitude(self, identified: float) -> float:
        """Return the true support amplitude [m] where `identified` [m] is."""
        return identified * (1.0 + self.off.amplitude)

    def height(self, commanded: float) -> float:
        """Return the true height [m] where `commanded` [m] is."""
        return max(commanded + self.off.height, self.damper.diameter)


def corners() -> Array:
    """Return 16 corners of the box (16, 8), each +1 or -1, in the order of `Deviation`."""
    return np.asarray(hadamard(16)[:, _COLUMNS], dtype=float)


def inside(count: int, seed: int) -> Array:
    """Return random points of the box (count, 8), from -1 to 1, evenly distributed."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(Deviation._fields)))


def deviation(problem: Problem, point: Array) -> Deviation:
    """Return the deviation at a point (8,) of the box, from -1 to 1 in each quantity."""
    sides = zip(point, Deviation._fields, strict=True)
    return Deviation(*(float(side) * getattr(problem.uncertainty, name) for side, name in sides))


def case(problem: Problem, fraction: float, off: Deviation = NOMINAL, rtol: float = RTOL) -> Case:
    """Return the case of a deviation with a grain of a mass fraction [-]."""
    scene = scene_of(problem, fraction, problem.amplitudes[1], problem.max_height, off)
    return Case(DamperResponse(scene, rtol), off, contact_of(scene))


def cases(problem: Problem, fraction: float, points: Array) -> Iterator[Case]:
    """Yield the case of each point (n, 8) of the box."""
    return (case(problem, fraction, deviation(problem, point)) for point in points)


def adverse(points: Array, values: Array) -> Array:
    """Return the corner (8,) with the largest value by the main effects of a two-level design.

    points: (16, 8) of -1 and 1; values: (16,) found there. The opposite corner has the least.
    """
    return np.where(points.T @ values >= 0.0, 1.0, -1.0)
