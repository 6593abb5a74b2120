# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the kernels are given of a scene: the system, and the contact law by its number with its parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from atpid_sim.contact.laws import NAMES
from atpid_sim.scene import Scene
from atpid_sim.system import Array, System


class Contact(NamedTuple):
    """A law by its number (`contact/laws.py`) and its parameters (6,) as that law's file lists them."""

    law: int
    parameters: Array


def system_of(scene: Scene) -> System:
    """Return the system a scene describes."""
    beam, grain = scene.beam, scene.grain
    modes = None if scene.modes is None else scene.modes.table
    return System(beam.mass, scene.grain_mass, beam.stiffness, beam.damping, scene.gravity, grain.radius, modes)


def contact_of(scene: Scene) -> Contact:
    """Return the contact a scene describes."""
    parameters = np.zeros(6)
    values = scene.contact.parameters(system_of(scene))
    parameters[: len(values)] = values
    return Contact(NAMES.index(scene.contact.law), parameters)


def restitution_of(contact: Contact, speed: float, mass: float) -> float:
    """Return the restitution [-] of an impact at `speed` [m/s] with the reduced `mass` [kg]."""
    from atpid_sim.contact import dispatch  # here: what needs the system alone starts without numba

    return float(dispatch.restitution(contact.law, float(speed), float(mass), contact.parameters))
