# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the kernels are given of a scene: the system, and the contact law by its number with its parameters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from atpid_sim.contact.laws import IMPACT, NAMES
from atpid_sim.scene import Scene
from atpid_sim.system import Array, System, reduced_mass

if TYPE_CHECKING:
    from atpid_sim.engine.meeting import Dampers


class Contact(NamedTuple):
    """A law by its number (`contact/laws.py`) and its parameters (6,) as that law's file lists them."""

    law: int
    parameters: Array


def system_of(scene: Scene) -> System:
    """Return the system a scene describes."""
    beam, grain = scene.beam, scene.grain
    modes = None if scene.modes is None else scene.modes.table
    return System(beam.mass, scene.grain_mass, beam.stiffness, beam.damping, scene.gravity, grain.radius, modes)


def systems_of(scene: Scene) -> list[System]:
    """Return the system of each damper; of a further one the mass is what an impulse there meets."""
    found = [system_of(scene)]
    for one in scene.dampers[1:]:
        masses = [mode.mass for mode in (scene.beam, *scene.further_modes)]
        compliance = sum(shape**2 / mass for shape, mass in zip(one.shapes, masses, strict=True))
        mass = 1.0 / max(compliance, 1e-9 / one.grain_mass)  # at a node of all modes nothing gives way
        found.append(found[0]._replace(beam_mass=mass, grain_mass=one.grain_mass, radius=one.radius, modes=None))
    return found


def dampers_of(scene: Scene) -> Dampers:
    """Return the dampers of a scene that has several, and the structure with them."""
    from atpid_sim.contact import dispatch  # here, as the next: what needs the system alone starts without numba
    from atpid_sim.engine.meeting import Dampers

    assert scene.modes is not None
    free, dampers, systems = np.vstack(scene.modes.free), scene.dampers, systems_of(scene)
    contacts = [contact_of(scene, system) for system in systems]
    rows = []
    for damper, system, (law, p) in zip(dampers, systems, contacts, strict=True):
        r, fast, crushing = damper.radius, math.inf, math.inf
        if law != IMPACT:  # without damping
            fast = math.sqrt(2.0 * float(dispatch.energy(law, r, r, p)) / reduced_mass(system))
            crushing = float(dispatch.force(law, r, 0.0, r, p))
        rows.append((damper.grain_mass, r, damper.height, fast, crushing))
    modes = scene.modes.free
    pace = math.sqrt(float(np.max(modes.stiffness / modes.mass)))
    return Dampers(
        free, np.array(rows), np.array([one.shapes for one in dampers]), contacts[0].law,
        np.array([one.parameters for one in contacts]), float(scene.gravity), pace,
        pace + float(np.max(modes.damping / modes.mass)),
    )  # fmt: skip


def contact_of(scene: Scene, system: System | None = None) -> Contact:
    """Return the contact a scene describes, by default of its first grain."""
    parameters = np.zeros(6)
    values = scene.contact.parameters(system or system_of(scene))
    parameters[: len(values)] = values
    return Contact(NAMES.index(scene.contact.law), parameters)


def restitution_of(contact: Contact, speed: float, mass: float) -> float:
    """Return the restitution [-] of an impact at `speed` [m/s] with the reduced `mass` [kg]."""
    from atpid_sim.contact import dispatch

    return float(dispatch.restitution(contact.law, float(speed), float(mass), contact.parameters))
