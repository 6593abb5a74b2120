# SPDX-License-Identifier: Apache-2.0
"""The systems that may be the true one, where a structure, its excitation and its ceiling are known within limits.

They are the corners of the box of uncertainties, in the order of a two-level design, so that the first ones already
show every quantity at both ends, and after them random ones inside.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import hadamard
from scipy.optimize import brentq

from atpid_sim.kernel_inputs import contact_of, restitution_of, system_of
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.system import Array, reduced_mass

#: Tolerance of the runs: 0.2 % of an amplitude is resolved.
_RTOL = 1e-4
#: Columns of the Hadamard matrix of order 16 that are the fractional factorial design 2^(5-1) of resolution V: five
#: factors at two levels in 16 runs, products of two clear of each other (Box, Hunter and Hunter: E = ABCD).
_COLUMNS = (1, 2, 4, 8, 15)
_CORNERS = 16
#: Random systems inside the box, and their seed.
_INSIDE, _SEED = 16, 18
#: Time in which the ceiling opens slowly [s].
_TRAVEL = 1.0
#: Largest logarithm of the factor by which the damping of a contact is changed, and the speed at which its restitution
#: is what it shall be [m/s].
_WIDEST, _SPEED = 5.0, 1.0


@dataclass(frozen=True)
class Uncertainty:
    """How far each quantity may lie from its value, to either side, apart from the amplitude."""

    stiffness: float = 0.05  # relative, of the beam: the model's own uncertainty [-]
    resolution: float = 5e-4  # of the ceiling's position [m]
    mass: float = 5e-3  # relative, of the beam [-]
    frequency: float = 5e-4  # relative, of the excitation: what identification leaves open [-]
    restitution: float = 0.05  # relative [-]


@dataclass(frozen=True)
class System:
    """A system that may be the true one."""

    damper: DamperResponse
    amplitude: float  # how far the support's amplitude lies from the identified one, in its error bars [-]
    frequency: float  # of the excitation, over the identified one [-]
    offset: float  # of the ceiling [m]
    travel: float  # time in which the ceiling opens [s]


def systems_of(scene: Scene, damper: DamperResponse, uncertainty: Uncertainty) -> list[System]:
    """Return the systems of a scene and its uncertainties, the expected one first.

    Each mass and restitution has a table of contacts, so they and the stiffness lie at their ends only.
    """
    made: dict[tuple[float, ...], DamperResponse] = {}
    found = [System(damper, 0.0, 1.0, 0.0, 0.0)]
    for k, (amplitude, frequency, *ends) in enumerate(points().tolist()):
        key = tuple(ends)
        if key not in made:
            made[key] = _changed(scene, damper.frequency, uncertainty, *ends)
        # a corner and the one that differs from it in the restitution alone are opened in different ways
        travel = _TRAVEL * ((k + k // _CORNERS) % 2)
        driven = 1.0 + frequency * uncertainty.frequency
        found.append(System(made[key], amplitude, driven, uncertainty.resolution, travel))
    return found


def points() -> Array:
    """Return points (n, 5) of the box: amplitude, frequency, mass, stiffness, restitution, each from -1 to 1.

    16 corners of a design, the 16 others, then corners of the last three with the first two anywhere inside.
    """
    first = np.asarray(hadamard(_CORNERS)[:, _COLUMNS], dtype=float)
    second = first * np.array([1.0, 1.0, 1.0, 1.0, -1.0])
    inside = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_INSIDE, 5))
    inside[:, 2:] = np.sign(inside[:, 2:])
    return np.concatenate([first, second, inside])


def _changed(
    scene: Scene, frequency: float, uncertainty: Uncertainty, mass: float, stiffness: float, restitution: float
) -> DamperResponse:
    """Return the response of a system at these ends, driven at the same frequency [Hz], its grain unchanged."""
    beam = scene.beam.model_dump()
    beam["mass"] *= 1.0 + mass * uncertainty.mass
    beam["stiffness"] *= 1.0 + stiffness * uncertainty.stiffness
    fraction = scene.grain_mass / (scene.grain_mass + beam["mass"])
    changed = scene.with_(beam=beam, mass_fraction=fraction)
    if isinstance(scene.excitation, HarmonicExcitation):
        changed = changed.with_(frequency=frequency)
    if uncertainty.restitution > 0.0:
        changed = with_restitution(changed, 1.0 + restitution * uncertainty.restitution)
    made = DamperResponse(changed, _RTOL)
    made.sufficient(0.0, math.inf)  # its table of contacts, in milliseconds
    return made


def with_stiffness(scene: Scene, damper: DamperResponse, factor: float) -> DamperResponse:
    """Return the response of a beam whose stiffness is `factor` times as large, driven at the same frequency."""
    beam = scene.beam.model_dump()
    beam["stiffness"] *= factor
    return DamperResponse(scene.with_(beam=beam, frequency=damper.frequency), _RTOL)


def with_restitution(scene: Scene, factor: float) -> Scene:
    """Return the scene with a contact whose restitution is `factor` times as large, at most 1.

    It is changed by the parameter that damps the contact, at the speed of the beam on its support's amplitude; a law
    without such a parameter, or without damping, stays as it is.
    """
    contact = scene.contact.model_dump(exclude_none=True)
    if "restitution" in contact:
        return scene.with_(contact=contact | {"restitution": min(contact["restitution"] * factor, 1.0)})
    name = next((name for name in ("damping_ratio", "damping") if contact.get(name)), None)
    if name is None:
        return scene
    mass, speed = reduced_mass(system_of(scene)), _SPEED
    wanted = min(restitution_of(contact_of(scene), speed, mass) * factor, 1.0 - 1e-9)

    def with_damping(log_factor: float) -> Scene:
        return scene.with_(contact=contact | {name: contact[name] * math.exp(log_factor)})

    def excess(log_factor: float) -> float:
        return restitution_of(contact_of(with_damping(log_factor)), speed, mass) - wanted

    if not excess(-_WIDEST) > 0.0 > excess(_WIDEST):
        return scene
    return with_damping(brentq(excess, -_WIDEST, _WIDEST, xtol=1e-3))
