# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every part computes with: arrays, and the system's masses, spring, damper and weight."""

from typing import NamedTuple

import numpy as np

from atpid_sim.modal import Array as Array
from atpid_sim.modal import ModeSet, container_mass, modes_in


class System(NamedTuple):
    """Beam and grain (equations 3.39 and 3.40), SI units; plain floats, so that numba kernels take it as it is."""

    beam_mass: float
    grain_mass: float
    stiffness: float
    damping: float
    gravity: float
    radius: float
    modes: Array | None = None  # `modal.Modes.table` of a structure that has several; the rest is then of the first


def structure_of(system: System, *, held: bool) -> ModeSet:
    """Return the structure's modes, also where it has one, with the grain held or in flight."""
    if system.modes is not None:
        modes = modes_in(system.modes)
        return modes.joined if held else modes.free
    mass = system.beam_mass + system.grain_mass if held else system.beam_mass
    drive = system.stiffness, system.damping
    return ModeSet(*(np.array([value]) for value in (mass, *drive, *drive, system.gravity)))


def reduced_mass(system: System) -> float:
    """Mass that the relative motion of grain and container feels in an impact, m_s m_g / (m_s + m_g) [kg]."""
    beam_mass = system.beam_mass if system.modes is None else container_mass(modes_in(system.modes).free)
    return beam_mass * system.grain_mass / (beam_mass + system.grain_mass)
