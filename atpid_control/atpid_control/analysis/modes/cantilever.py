# SPDX-License-Identifier: Apache-2.0
"""Modes of a cantilever with a body at its tip, by Euler-Bernoulli finite elements.

Elements with cubic shapes and consistent mass: M. Petyt, Introduction to Finite Element Vibration Analysis, 3.5.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh

from atpid_control.analysis.modes.structure import AT_REST, Mode, ModesError, Structure

#: Elements, with which mode 20 of a bare beam is off by 2.4e-4.
_ELEMENTS = 80
#: Modes at most.
MOST_MODES = 20
#: E/(kappa G) of a rectangular section and a Poisson's ratio of 0.3 [-].
_SHEAR = 3.12


class Cantilever(NamedTuple):
    """A prismatic beam of rectangular section, clamped at one end."""

    length: float  # [m]
    width: float  # [m]
    thickness: float  # in the direction of the motion [m]
    modulus: float  # [Pa]
    density: float  # [kg/m^3]
    tip_mass: float = 0.0  # [kg]
    tip_inertia: float = 0.0  # about the tip [kg m^2]

    @property
    def bending_stiffness(self) -> float:
        """Modulus times second moment of area [N m^2]."""
        return self.modulus * self.width * self.thickness**3 / 12.0

    @property
    def mass(self) -> float:
        """Mass of the beam alone [kg]."""
        return self.density * self.length * self.width * self.thickness


def modes_of(beam: Cantilever, count: int, force_at: float | None = None) -> Structure:
    """Return `count` + 1 modes; force_at: where a force acts, from the clamp [m]. Raises ModesError."""
    if force_at is not None and not 0.0 < force_at <= beam.length:
        raise ModesError(f"--force-at: given {force_at:g} m; allowed: above 0 to the beam's length, {beam.length:g} m")
    stiffness, mass = _matrices(beam)
    # the base's motion is that of all nodes and of no slope; the clamped node has no coordinate of its own
    base = mass[2:, ::2].sum(axis=1)
    # the largest of 1 / omega^2, and not the smallest of omega^2, of which a heavy tip leaves no digits
    last = 2 * _ELEMENTS - 1
    inverse, shapes = eigh(mass[2:, 2:], stiffness[2:, 2:], subset_by_index=(last - count, last))
    shapes /= np.sqrt(inverse)  # to a modal mass of 1
    along = np.linspace(0.0, beam.length, _ELEMENTS + 1)
    modes = []
    for number, (one, shape) in enumerate(zip(inverse[::-1], shapes.T[::-1], strict=True), 1):
        at_tip, whole = shape[-2], np.concatenate(([0.0, 0.0], shape))
        if abs(at_tip) < AT_REST * np.abs(shape[::2]).max():
            raise ModesError(f"mode {number} is at rest at the tip, whose mass is too large for it; give fewer --modes")
        curve = CubicHermiteSpline(along, whole[::2], whole[1::2])
        modes.append(
            Mode(
                frequency=1.0 / (2.0 * math.pi * math.sqrt(one)),
                mass=1.0 / at_tip**2,
                damping_ratio=0.0,
                base=float(shape @ base * at_tip),
                force=float(curve(beam.length if force_at is None else force_at) / at_tip),
                slope=float(shape[-1] / at_tip),
            )
        )
    return Structure(tuple(modes), beam.length**3 / (3.0 * beam.bending_stiffness), (_shear(beam, modes[:count]),))


def _matrices(beam: Cantilever) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stiffness and mass (2 nodes, 2 nodes) of displacement [m] and slope [rad] at each node."""
    h, m = beam.length / _ELEMENTS, beam.mass / _ELEMENTS
    scale = np.outer((1.0, h, 1.0, h), (1.0, h, 1.0, h))
    bent = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    moved = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    stiffness, mass = np.zeros((2, 2 * _ELEMENTS + 2, 2 * _ELEMENTS + 2))
    for first in range(0, 2 * _ELEMENTS, 2):
        part = slice(first, first + 4)
        stiffness[part, part] += beam.bending_stiffness / h**3 * scale * bent
        mass[part, part] += m / 420.0 * scale * moved
    mass[-2, -2] += beam.tip_mass
    mass[-1, -1] += beam.tip_inertia
    return stiffness, mass


def _shear(beam: Cantilever, modes: list[Mode]) -> str:
    """Return how much shear and rotary inertia would lower the last frequency (Timoshenko, Vibration Problems)."""
    omega, section = 2.0 * math.pi * modes[-1].frequency, beam.mass / beam.length / beam.bending_stiffness
    share = math.sqrt(section) * omega * beam.thickness**2 / 24.0 * (1.0 + _SHEAR)
    return f"shear and rotary inertia, left out, lower the last frequency by about {100 * share:.2g} %"
