# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The systems that may be the true one, where a structure, its excitation and its ceiling are known within limits.

They are the corners of the box of uncertainties, in the order of a two-level design, so that the first ones already
show every quantity at both ends, after them random ones inside, the ends of each quantity alone, and the corners twice
again: opened in the other way to a height that is too low, and raised from half the clearance at once.
"""

import math
from dataclasses import dataclass

import numpy as np

from atpid_sim.maps import Approach, DamperResponse
from atpid_sim.maps.ratings import JUMPS, at_once, opened
from atpid_sim.robust import corners, inside, with_beam, with_restitution
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: Tolerance of the runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-4
#: Random systems inside the box, and their seed.
_INSIDE, _SEED = 16, 18
#: Corners of a two-level design; there are twice as many.
_CORNERS = 16


@dataclass(frozen=True)
class MarginBox:
    """How far each quantity may lie from its value, to either side, apart from the amplitude.

    The excitation's frequency is identified, and with it the beam's mass is known but for its stiffness.
    """

    stiffness: float = 0.02  # relative, of the beam: the model's own uncertainty [-]
    resolution: float = 5e-4  # of the ceiling's position [m]
    mass: float = 5e-3  # relative, of the beam [-]
    frequency: float = 5e-4  # relative, of the excitation [-]
    restitution: float = 0.05  # relative [-]


@dataclass(frozen=True)
class UncertainSystem:
    """A system that may be the true one."""

    damper: DamperResponse
    amplitude: float  # how far the support's amplitude lies from the identified one, in its error bars [-]
    frequency: float  # of the excitation, over the identified one [-]
    offset: float  # of the ceiling [m]
    approach: Approach  # how the ceiling comes to its height


def systems_of(scene: Scene, damper: DamperResponse, uncertainty: MarginBox) -> list[UncertainSystem]:
    """Return the systems of a scene and its uncertainties, the expected one first.

    Each mass and restitution has a table of contacts, so they and the stiffness lie at their ends only.
    """
    made: dict[tuple[float, ...], DamperResponse] = {}
    found = [UncertainSystem(damper, 0.0, 1.0, 0.0, at_once)]
    for (amplitude, frequency, *ends), (approach, side) in zip(points().tolist(), _approaches(), strict=True):
        key = tuple(ends)
        if key not in made:
            made[key] = _changed(scene, damper.frequency, uncertainty, *ends)
        driven = 1.0 + frequency * uncertainty.frequency
        found.append(UncertainSystem(made[key], amplitude, driven, side * uncertainty.resolution, approach))
    return found


def points() -> Array:
    """Return points (n, 5) of the box: amplitude, frequency, mass, stiffness, restitution, each from -1 to 1.

    16 corners of a design, the 16 others, then corners of the last three with the first two anywhere inside, the middle
    of each face, and the 32 corners twice again.
    """
    first = corners(5)
    second = first * np.array([1.0, 1.0, 1.0, 1.0, -1.0])
    drawn = inside(_INSIDE, 5, _SEED)
    drawn[:, 2:] = np.sign(drawn[:, 2:])
    return np.concatenate([first, second, drawn, np.eye(5), -np.eye(5), *(2 * [first, second])])


def _approaches() -> list[tuple[Approach, float]]:
    """Return how the ceiling comes to its height at each of `points`, and to which side of it it errs (1 or -1).

    A corner and the one that differs from it in the restitution alone are opened in different ways.
    """
    pair, size = 2 * _CORNERS, len(points()) - 2 * 2 * _CORNERS
    turns = [(k + k // _CORNERS) % 2 for k in range(size)]
    first = [((at_once, opened)[turn], 1.0) for turn in turns]
    lower = [((opened, at_once)[turn], -1.0) for turn in turns[:pair]]
    return [*first, *lower, *((JUMPS[turn], 1.0) for turn in turns[:pair])]


def _changed(
    scene: Scene, frequency: float, uncertainty: MarginBox, mass: float, stiffness: float, restitution: float
) -> DamperResponse:
    """Return the response of a system at these ends, driven at the same frequency [Hz], its grain unchanged."""
    changed = with_beam(scene, mass=1.0 + mass * uncertainty.mass, stiffness=1.0 + stiffness * uncertainty.stiffness)
    if scene.excitation.is_tone:
        changed = changed.with_(frequency=frequency)
    if uncertainty.restitution > 0.0:
        # a contact without such a parameter stays as it is
        changed = with_restitution(changed, 1.0 + restitution * uncertainty.restitution) or changed
    made = DamperResponse(changed, _RTOL)
    made.sufficient(0.0, math.inf)  # its table of contacts, in milliseconds
    return made
