# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the phases of a run compute where the structure has several modes (`atpid_sim.modal`), and where it has one.

`modes` is None where there is one. That is decided when a kernel is compiled: a run of one mode computes what it would
without this file.
"""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import arc_from, support_at
from atpid_sim.engine.beam import fastest_of
from atpid_sim.engine.modal_arc import modal_arc, mode_arc
from atpid_sim.engine.modal_beam import mode_at, turning_pace
from atpid_sim.kernel import chosen, kernel


def _no_states(modes, y):
    return None


def _own_states(modes, y):
    return y[at.STATE_SIZE :].copy().reshape(-1, at.MODE_COLUMNS)


#: (modes, y) -> copy of the modes' part of a state (modes, MODE_COLUMNS); None where there is one mode.
states_of = chosen(_no_states, _own_states)


@kernel
def container_mass(modes, system):
    """Mass that an impulse at the container meets [kg]."""
    if modes is None:
        return system.beam_mass
    inverse = 0.0
    for i in range(modes.shape[1]):
        inverse += 1.0 / modes[at.MASS, i]
    return 1.0 / inverse


@kernel
def resting_place(modes, system):
    """Displacement of the container at rest with the grain on it [m]."""
    if modes is None:
        return -(system.beam_mass + system.grain_mass) * system.gravity / system.stiffness
    sag = system.beam_mass * system.gravity / system.stiffness
    for i in range(modes.shape[1]):
        sag += system.grain_mass * system.gravity / modes[at.STIFFNESS, i]
    return -sag


@kernel
def mode_paces(modes):
    """Highest angular frequency of several modes, and fastest rate at which one moves [rad/s]; 0 where there is one."""
    highest = rate = 0.0
    if modes is not None:
        for i in range(modes.shape[1]):
            natural, decay = modes[at.STIFFNESS, i] / modes[at.MASS, i], 0.5 * modes[at.DAMPING, i] / modes[at.MASS, i]
            highest = max(highest, math.sqrt(natural))
            rate = max(rate, math.sqrt(natural), decay + math.sqrt(max(0.0, decay * decay - natural)))
    return highest, rate


def _fastest(modes, arc, observing):
    return fastest_of(arc)


def _turning(modes, arc, observing):
    return turning_pace(arc, observing)


#: (modes, arc, observing) -> reciprocal of the longest step in flight [rad/s]: two turning points are never in one.
stride_pace = chosen(_fastest, _turning)


@kernel
def free_acceleration(modes, states, u, w):
    """Acceleration of the container without contact, its weight left out [m/s^2]; u, w: signal and its rate."""
    a = 0.0
    for i in range(modes.shape[1]):
        force = modes[at.DIRECT, i] * u + modes[at.RATE, i] * w
        force -= modes[at.STIFFNESS, i] * states[i, at.Q] + modes[at.DAMPING, i] * states[i, at.Q_RATE]
        a += force / modes[at.MASS, i]
    return a


@kernel
def to_joined(modes):
    """Matrix that leads from coordinates in flight to joined ones (modes, modes)."""
    return modes[2 * at.SET_ROWS : 2 * at.SET_ROWS + modes.shape[1]]


@kernel
def from_joined(modes):
    """Matrix that leads back."""
    return modes[2 * at.SET_ROWS + modes.shape[1] : 2 * (at.SET_ROWS + modes.shape[1])]


@kernel
def transformed(matrix, states):
    """Displacements and velocities (modes, 2) in other coordinates; states (modes, 2 or more)."""
    count = matrix.shape[0]
    found = np.zeros((count, 2))
    for i in range(count):
        for k in range(count):
            found[i, at.Q] += matrix[i, k] * states[k, at.Q]
            found[i, at.Q_RATE] += matrix[i, k] * states[k, at.Q_RATE]
    return found


def _arc(modes, y, mass, system, segment, tau):
    return arc_from(mass, system, segment, tau, y[at.BEAM], y[at.BEAM_VELOCITY])


def _free_arcs(modes, y, mass, system, segment, tau):
    return modal_arc(modes, 0, y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS), segment, tau)


def _joined_arcs(modes, y, mass, system, segment, tau):
    states = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    return modal_arc(modes, at.SET_ROWS, transformed(to_joined(modes), states), segment, tau)


#: (modes, y, mass, system, segment, tau) -> arc of the beam alone, whose `mass` is given [kg], from local time tau.
free_arc = chosen(_arc, _free_arcs)
#: The same of beam and grain as one mass.
joined_arc = chosen(_arc, _joined_arcs)


@kernel
def coordinates(modes, arc, tau):
    """Displacements and velocities (modes, 2) of the modes of an arc at local time tau."""
    found = np.empty((arc.modes.shape[1], 2))
    for i in range(arc.modes.shape[1]):
        found[i, at.Q], found[i, at.Q_RATE] = mode_at(mode_arc(arc.modes, i), arc.phase, tau)
    return found


@kernel
def _enter_coordinates(y, found):
    states = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    for i in range(states.shape[0]):
        states[i, at.Q], states[i, at.Q_RATE] = found[i, at.Q], found[i, at.Q_RATE]


@kernel
def leave_flight(modes, y, arc, tau):
    """Enter where a flight has led the modes."""
    if modes is not None:
        _enter_coordinates(y, coordinates(modes, arc, tau))


@kernel
def leave_joined(modes, y, arc, tau):
    """Enter where the motion with the grain held has led the modes."""
    if modes is not None:
        _enter_coordinates(y, transformed(from_joined(modes), coordinates(modes, arc, tau)))


@kernel
def grain_acceleration(modes, system, segment, arc, tau, a):
    """Acceleration that the wall gives a grain held, its weight included [m/s^2]; a: of the container, in its arc.

    Of several modes it follows from the forces of springs and dampers, as in the flight that may come next: what the
    joined modes leave out of the damping would else let the grain leave and touch again without end.
    """
    if modes is None:
        return a + system.gravity
    u, w = support_at(segment, tau)
    apart = free_acceleration(modes, transformed(from_joined(modes), coordinates(modes, arc, tau)), u, w)
    return apart / (1.0 + system.grain_mass / container_mass(modes, system))


@kernel
def kick(modes, y, impulse):
    """Enter an upward impulse on the container [N s]."""
    if modes is None:
        return
    states = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    for i in range(states.shape[0]):
        change = impulse / modes[at.MASS, i]
        states[i, at.Q_CONTACT] += impulse * (states[i, at.Q_RATE] + 0.5 * change)
        states[i, at.Q_RATE] += change


@kernel
def distances(modes, y, other):
    """Distance of two states: displacements [m], then velocities [m/s], of all modes and the grain together."""
    moved, faster = abs(y[at.BEAM] - other[at.BEAM]), abs(y[at.BEAM_VELOCITY] - other[at.BEAM_VELOCITY])
    if modes is not None:
        moved = faster = 0.0
        for i in range(modes.shape[1]):
            begin = at.STATE_SIZE + i * at.MODE_COLUMNS
            moved += abs(y[begin + at.Q] - other[begin + at.Q])
            faster += abs(y[begin + at.Q_RATE] - other[begin + at.Q_RATE])
    moved += abs(y[at.GRAIN] - other[at.GRAIN])
    return moved, faster + abs(y[at.GRAIN_VELOCITY] - other[at.GRAIN_VELOCITY])
