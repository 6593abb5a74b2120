# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The structures a comparison is made on: the scene's own, and those that differ from it by 5 % in one value."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from atpid_common.errors import InputError
from atpid_sim import robust
from atpid_sim.robust import restitution, with_beam
from atpid_sim.scene import Scene

#: The relative error of the model.
ERROR = 0.05


class ComparisonError(InputError):
    """A scene that cannot be compared; one line: what was given, what is allowed, what to do."""


@dataclass(frozen=True)
class Structure:
    """What vibrates, while heights and tuned masses are computed from a model of it."""

    name: str  # the value in which it differs from the model, with the sign
    scene: Scene


def levels(scene: Scene) -> tuple[float, ...]:
    """Return the support amplitudes [m] the scene holds, in order. Raises ComparisonError where there are none."""
    if not scene.excitation.is_tone:
        kind = scene.excitation.kind
        raise ComparisonError(f"excitation: given a {kind} one; allowed: a tone {{amplitude, frequency}}")
    points = scene.excitation.amplitude_points
    if len(points) == 1:
        return (points[0][1],)
    held = [one for (_, one), (_, other) in pairwise(points) if one == other and one > 0.0]
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
            other = with_restitution(scene, factor) if value == "restitution" else with_beam(scene, **{value: factor})
            found.append(Structure(f"{value} {100.0 * (factor - 1.0):+.0f} %", other))
    return found


def with_restitution(scene: Scene, factor: float) -> Scene:
    """Return the scene with the restitution of its contact multiplied. Raises ComparisonError."""
    if {"restitution", "damping_ratio"}.isdisjoint(scene.contact.model_dump(exclude_none=True)):
        law = scene.contact.law
        raise ComparisonError(f"contact.law: given {law}; allowed: one with the key restitution or damping_ratio")
    changed = robust.with_restitution(scene, factor)
    if changed is None:
        raise ComparisonError(f"contact.damping_ratio: no other leads to {factor:g} times its restitution")
    return changed


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
    if scene.excitation.tone_frequency != "resonance":
        given = f"excitation.frequency: given {scene.frequency_hz:g} Hz"
        raise ComparisonError(f"{given}; allowed: resonance, where all of them are compared")
