# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A structure of several modes: in flight, and with the masses of all grains where they are.

A mode's coordinate is its part of the container's displacement, so that its mass is the one which an impulse at the
container meets. In flight the modes do not couple, and while the grain moves with the container its joined ones do
not: those of the structure with the grain's mass at the container, of whose damping what couples them is left out.

A signal s drives a mode by the force `direct` s + `rate` s'. A moving support has shares of stiffness and damping, a
force acts directly.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Numbers; the docstrings give shape and unit.
Array = NDArray[np.float64]

#: Motion of the container in a joined mode, over the largest, below which it has a node there.
_NODE = 1e-6
#: Dynamic over static stiffness of a mode up to which its response has no bound: what rounding leaves at resonance.
_UNBOUNDED = 1e-9


class ModeSet(NamedTuple):
    """Uncoupled modes, the first the one that matters most; (modes,) each [SI units], as in `engine.columns`."""

    mass: Array
    stiffness: Array
    damping: Array
    direct: Array
    rate: Array
    gravity: Array

    @property
    def frequencies(self) -> Array:
        """Natural frequencies without damping (modes,) [Hz]."""
        return np.asarray(np.sqrt(self.stiffness / self.mass) / (2.0 * math.pi))


class Modes(NamedTuple):
    """A structure in flight and with the grain held, and how coordinates of the one become those of the other."""

    free: ModeSet
    joined: ModeSet
    to_joined: Array  # (modes, modes)
    from_joined: Array

    @property
    def table(self) -> Array:
        """What kernels take (2 SET_ROWS + 2 modes, modes): one array, since each costs time at every call."""
        return np.vstack([*self.free, *self.joined, self.to_joined, self.from_joined])


def modes_of(free: ModeSet, grain: float, gravity: float) -> Modes:
    """Return the modes of a structure in flight, and joined by the grain [kg]; gravity [m/s^2]."""
    joined_mass = np.diag(free.mass) + grain
    from scipy.linalg import eigh  # here, since most scenes have one mode, and it loads slowly

    squares, shapes = eigh(np.diag(free.stiffness), joined_mass)
    # a mode with a node at the container, as where two frequencies are the same, is one that hardly moves it
    at_container = shapes.sum(axis=0)
    least = _NODE * np.abs(at_container).max()
    at_container = np.where(np.abs(at_container) < least, np.copysign(least, at_container), at_container)
    first = int(np.argmax(np.abs(shapes[0])))  # the one that is most like the first
    order = [first, *(k for k in range(len(squares)) if k != first)]
    shapes, squares, mass = (shapes / at_container)[:, order], squares[order], at_container[order] ** -2.0
    weight = -free.mass * free.gravity - grain * gravity
    damping = np.einsum("ij,i,ij->j", shapes, free.damping, shapes)
    direct, rate = shapes.T @ free.direct, shapes.T @ free.rate
    joined = ModeSet(mass, squares * mass, damping, direct, rate, -(shapes.T @ weight) / mass)
    to_joined = np.ascontiguousarray((shapes / mass).T @ joined_mass)
    return Modes(free, joined, to_joined, np.ascontiguousarray(shapes))


def coupling(modes: Modes) -> float:
    """Return how much the damping left out couples joined modes: its power over the distance of their squares [-].

    Of two modes that is |c| w / |w1^2 - w2^2|, w the larger angular frequency; the error of a motion is about its
    square (Hasselman, AIAA J. 14 (1976) 1627).
    """
    squares, shapes = modes.joined.stiffness / modes.joined.mass, modes.from_joined
    damping = (
        shapes.T @ (modes.free.damping[:, None] * shapes) / np.sqrt(np.outer(modes.joined.mass, modes.joined.mass))
    )
    first, second = np.triu_indices(len(squares), 1)
    left_out = np.abs(damping[first, second]) * np.sqrt(np.maximum(squares[first], squares[second]))
    apart = np.abs(squares[first] - squares[second])
    # what is damped alike is not coupled, however close: rounding of the shapes is no damping
    counts = left_out > 1e-9 * np.maximum(squares[first], squares[second])
    with np.errstate(divide="ignore"):
        return float(np.max(left_out[counts] / apart[counts], initial=0.0))


def modes_in(table: Array) -> Modes:
    """Return the modes from what kernels take (`Modes.table`)."""
    rows, count = len(ModeSet._fields), table.shape[1]
    free, joined, both = np.split(table, (rows, 2 * rows))
    return Modes(ModeSet(*free), ModeSet(*joined), both[:count], both[count:])


def container_mass(modes: ModeSet) -> float:
    """Return the mass that an impulse at the container meets [kg]."""
    return float(1.0 / np.sum(1.0 / modes.mass))


def static_response(modes: ModeSet) -> float:
    """Return how far all modes together move at most under a constant unit of the drive's signal [m]."""
    return float(np.abs(modes.direct / modes.stiffness).sum())


def phasors(modes: ModeSet, frequency: float, amplitude: float = 1.0) -> NDArray[np.complex128]:
    """Return each mode's steady displacement (modes,) for an amplitude of the drive's signal at `frequency` [Hz].

    Their sum is the container's, against the signal's sine; infinite at the resonance of a mode without damping.
    """
    omega = 2.0 * np.pi * frequency
    force = amplitude * (modes.direct + 1j * omega * modes.rate)
    resistance = modes.stiffness - modes.mass * omega * omega + 1j * omega * modes.damping
    bounded = np.abs(resistance) > _UNBOUNDED * modes.stiffness
    # divided by Python, whose last digits differ from those of numpy
    pairs = zip(force.tolist(), resistance.tolist(), bounded, strict=True)
    return np.array([each / by if ends else complex(np.inf) for each, by, ends in pairs])


def bare_amplitude(mass: float, stiffness: float, damping: float, amplitude: float, frequency: float) -> float:
    """Return the steady absolute amplitude [m] of one mass [kg] whose support moves by `amplitude` [m].

    stiffness [N/m] and damping [N s/m] lie between support and mass, so the force through both drives it (Eq. 3.39
    without a grain); frequency [Hz]. With the structure's own mass that is the structure as it is without the damper,
    with the grain's added the one with the damper closed. Infinite at the resonance without damping.
    """
    omega = 2.0 * math.pi * frequency
    drive = complex(stiffness, damping * omega)
    resistance = complex(stiffness - mass * omega * omega, damping * omega)
    return amplitude * abs(drive) / abs(resistance) if resistance else math.inf


def resting(modes: ModeSet) -> Array:
    """Return each mode's displacement under the weight (modes,) [m]."""
    rest: Array = -modes.mass * modes.gravity / modes.stiffness
    return rest
