# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The worst case over a box of uncertain quantities: points of it, scenes with its values, the best height there."""

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.maps.ratings import FLAT
from atpid_sim.root import root
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency
from atpid_sim.system import Array, reduced_mass

_CORNERS = 16
#: Columns of the Hadamard matrix of order 16 by the number of quantities (Box, Hunter and Hunter, Statistics for
#: Experimenters, table 6.22). Five: the design 2^(5-1) of resolution V, E = ABCD, products of two clear of each other.
#: Eight: 2^(8-4) of resolution IV, E = BCD, F = ACD, G = ABC, H = ABD, main effects clear of products of two.
_COLUMNS = {5: (1, 2, 4, 8, 15), 8: (1, 2, 4, 8, 14, 13, 7, 11)}
#: The columns that are left, for the ninth quantity and further ones.
_FURTHER = (3, 5, 6, 9, 10, 12, 15)
#: Speed at which a restitution is changed [m/s]; how far the damping of the contact is changed for it, as a factor.
_SPEED, _WIDEST = 1.0, 128.0
#: Largest restitution of a contact with damping [-].
_ELASTIC = 1.0 - 1e-9
#: An irregular motion counts as this many times as large: a height that is safe avoids it.
RUMBLE = 1.5


def corners(quantities: int) -> Array:
    """Return corners of the box (16, `quantities`), each value +1 or -1: a two-level design of 5, 8 or more quantities.

    Up to 15 their main effects are apart; those beyond change with one of the ninth to fifteenth.
    """
    matrix = np.ones((1, 1))
    while len(matrix) < _CORNERS:
        matrix = np.block([[matrix, matrix], [matrix, -matrix]])
    if quantities in _COLUMNS:
        return matrix[:, _COLUMNS[quantities]]
    return matrix[:, (*_COLUMNS[8], *itertools.islice(itertools.cycle(_FURTHER), quantities - 8))]


def inside(count: int, quantities: int, seed: int) -> Array:
    """Return random points of the box (`count`, `quantities`), evenly distributed."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, quantities))


def adverse(points: Array, values: Array) -> Array:
    """Return the corner (quantities,) with the largest value by the main effects of a two-level design.

    points: (16, quantities) of -1 and 1; values: (16,) computed there. The opposite corner has the least.
    """
    return np.where(points.T @ values >= 0.0, 1.0, -1.0)


def with_beam(scene: Scene, **factors: float) -> Scene:
    """Return the scene with values of its beam (`mass=`, `stiffness=`, ...) multiplied; the grain keeps its mass."""
    beam = scene.beam.model_dump()
    for key, factor in factors.items():
        beam[key] *= factor
    fraction = scene.grain_mass / (scene.grain_mass + beam["mass"])
    return scene.with_(beam=beam, mass_fraction=fraction)


def restitution(scene: Scene) -> float:
    """Return the restitution [-] between container and grain at 1 m/s."""
    return restitution_of(contact_of(scene), _SPEED, reduced_mass(system_of(scene)))


def with_restitution(scene: Scene, factor: float) -> Scene | None:
    """Return the scene with a contact whose restitution is `factor` times as large, at most 1; None: it cannot be set.

    A law without a parameter for it is changed by the one that damps the contact, at 1 m/s. It cannot be set where a
    law has none, or no damping, or where no damping leads to that restitution.
    """
    contact = scene.contact.model_dump(exclude_none=True)
    if "restitution" in contact:
        return scene.with_(contact=contact | {"restitution": min(contact["restitution"] * factor, 1.0)})
    name = next((name for name in ("damping_ratio", "damping") if contact.get(name)), None)
    if name is None:
        return None
    present = float(contact[name])
    wanted = min(factor * restitution(scene), _ELASTIC)

    def damped(value: float) -> Scene:
        return scene.with_(contact=contact | {name: value})

    def excess(value: float) -> float:
        return restitution(damped(value)) - wanted

    low, high = 0.5 * present, 2.0 * present
    while excess(low) < 0.0 and low > present / _WIDEST:
        low *= 0.5
    while excess(high) > 0.0 and high < present * _WIDEST:
        high *= 2.0
    if not excess(low) > 0.0 > excess(high):
        return None
    return damped(root(excess, low, high, xtol=1e-12))


class Response(NamedTuple):
    """The response of one system at a height."""

    amplitude: float  # of the beam, half peak-to-peak [m]
    efficiency: float  # 1 - amplitude / amplitude of the same system with the damper closed [-]
    regular: bool
    bare: float = math.nan  # the same system without the damper, where that is asked for [m]

    @property
    def reduction(self) -> float:
        """1 - amplitude / amplitude of the same system without the damper [-]."""
        return efficiency(self.amplitude, self.bare)

    @property
    def rating(self) -> float:
        """The amplitude [m], raised where the motion is irregular."""
        return self.amplitude * (1.0 if self.regular else RUMBLE)


def lowest_best(worst: Mapping[float, float]) -> float:
    """Return the lowest height [m] of {height [m]: largest rating over the systems [m]} that is as good as the best."""
    limit = min(worst.values()) * (1.0 + FLAT)
    return min(height for height, rating in worst.items() if rating <= limit)
