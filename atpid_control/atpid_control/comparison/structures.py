# SPDX-License-Identifier: Apache-2.0
"""The structures a comparison is made on: the scene's own, and those that differ from it by 5 % in one value."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from scipy.optimize import brentq

from atpid_common.errors import InputError
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import HarmonicExcitation, Scene
from atpid_sim.system import reduced_mass

#: The relative error of the model.
ERROR = 0.05
#: Speed at which a restitution is compared [m/s]: the laws that can be compared have the same at every speed.
_SPEED = 1.0


class ComparisonError(InputError):
    """A scene that cannot be compared; one line: what was given, what is allowed, what to do."""


@dataclass(frozen=True)
class Structure:
    """What vibrates, while heights and tuned masses are computed from a model of it."""

    name: str  # the value in which it differs from the model, with the sign
    scene: Scene


def levels(scene: Scene) -> tuple[float, ...]:
    """Return the support amplitudes [m] the scene holds, in order. Raises ComparisonError where there are none."""
    if not isinstance(scene.excitation, HarmonicExcitation):
        kind = scene.excitation.kind
        raise ComparisonError(f"excitation: given a {kind} one; allowed: a tone {{amplitude, frequency}}")
    given = scene.excitation.amplitude
    if isinstance(given, float):
        return (given,)
    held = [one for (_, one), (_, other) in pairwise(given) if one == other and one > 0.0]
    if not held:
        raise ComparisonError("excitation.amplitude: given ramps alone; allowed: amplitudes that are held for a time")
    return tuple(dict.fromkeys(held))


def structures(scene: Scene) -> list[Structure]:
    """Return the scene's structure and those with 5 % more or less of one value, each at its own resonance.

    The grain stays what it is. Raises ComparisonError where the contact has no restitution that can be set.
    """
    _check_frequency(scene)
    found = [Structure("as modelled", scene)]
    for value in ("mass", "stiffness", "damping", "restitution"):
        for sign in (-1.0, 1.0):
            factor = 1.0 + sign * ERROR
            other = with_restitution(scene, factor) if value == "restitution" else with_beam(scene, value, factor)
            found.append(Structure(f"{value} {100.0 * (factor - 1.0):+.0f} %", other))
    return found


def with_beam(scene: Scene, key: str, factor: float) -> Scene:
    """Return the scene with a value of its beam multiplied; the grain keeps its mass."""
    beam = scene.beam.model_dump()
    beam[key] *= factor
    fraction = scene.grain_mass / (scene.grain_mass + beam["mass"])
    return scene.with_(beam=beam, mass_fraction=fraction)


def with_restitution(scene: Scene, factor: float) -> Scene:
    """Return the scene with the restitution of its contact multiplied. Raises ComparisonError."""
    contact = scene.contact.model_dump(exclude_none=True)
    if "restitution" in contact:
        return scene.with_(contact=contact | {"restitution": factor * contact["restitution"]})
    if "damping_ratio" not in contact:
        law = contact["law"]
        raise ComparisonError(f"contact.law: given {law}; allowed: one with the key restitution or damping_ratio")
    wanted, given = factor * restitution(scene), float(contact["damping_ratio"])

    def off(damping_ratio: float) -> float:
        return restitution(scene.with_(contact=contact | {"damping_ratio": damping_ratio})) - wanted

    found = float(brentq(off, 0.5 * given, 2.0 * given, xtol=1e-12))
    return scene.with_(contact=contact | {"damping_ratio": found})


def restitution(scene: Scene) -> float:
    """Return the restitution [-] between container and grain."""
    mass = reduced_mass(DamperResponse(scene).system)
    return restitution_of(contact_of(scene), _SPEED, mass)


def description(scene: Scene) -> dict[str, Any]:
    """Return the scene's dimensionless values, for a table."""
    beam = scene.beam
    return {
        "frequency": scene.natural_frequency_hz,
        "mass_fraction": scene.grain.mass_fraction,
        "damping_ratio": beam.damping / (2.0 * (beam.stiffness * beam.mass) ** 0.5),
        "restitution": restitution(scene),
    }


def _check_frequency(scene: Scene) -> None:
    excitation = scene.excitation
    if isinstance(excitation, HarmonicExcitation) and excitation.frequency != "resonance":
        given = f"excitation.frequency: given {excitation.frequency:g} Hz"
        raise ComparisonError(f"{given}; allowed: resonance, where all of them are compared")
