# SPDX-License-Identifier: Apache-2.0
"""What the phases of a run compute where the structure has several modes (`atpid_sim.modal`), and where it has one.

`modes` is None where there is one. That is decided when a kernel is compiled: a run of one mode computes what it would
without this file.
"""

import math

import numpy as np

from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import OTHER_COLUMNS, arc_from, enter_other, other_arc, support_at
from atpid_sim.engine.beam import mode_at
from atpid_sim.kernel import chosen, kernel
from atpid_sim.system import System


@kernel
def _signal_of(modes, i, segment, row):
    """Write the support's motion that drives a mode as the row's signal does; returns nothing."""
    stiffness, damping, direct, rate = (
        modes[at.STIFFNESS, i],
        modes[at.DAMPING, i],
        modes[at.DIRECT, i],
        modes[at.RATE, i],
    )
    row[:] = segment
    c0, c1, c2, c3 = segment[at.C0], segment[at.C1], segment[at.C2], segment[at.C3]
    row[at.C3] = direct * c3 / stiffness
    row[at.C2] = (direct * c2 + 3.0 * (rate * c3 - damping * row[at.C3])) / stiffness
    row[at.C1] = (direct * c1 + 2.0 * (rate * c2 - damping * row[at.C2])) / stiffness
    row[at.C0] = (direct * c0 + rate * c1 - damping * row[at.C1]) / stiffness
    if segment[at.A0] == 0.0 and segment[at.A1] == 0.0:
        return
    omega = segment[at.OMEGA]
    share = complex(direct, omega * rate) / complex(stiffness, omega * damping)
    size = abs(share)
    row[at.A0], row[at.A1] = size * segment[at.A0], size * segment[at.A1]
    row[at.PHASE] = segment[at.PHASE] + math.atan2(share.imag, share.real)


@kernel
def _arcs(modes, states, segment, tau):
    """Arcs of all modes from local time tau, whose displacements and velocities are in `states` (modes, ...)."""
    count = modes.shape[1]
    others, row = np.empty((count - 1, OTHER_COLUMNS)), np.empty(at.DRIVE_COLUMNS)
    for i in range(1, count):
        _signal_of(modes, i, segment, row)
        arc = arc_from(modes[at.MASS, i], _mode(modes, i), row, tau, states[i, at.Q], states[i, at.Q_RATE])
        enter_other(others[i - 1], arc)
    _signal_of(modes, 0, segment, row)
    return arc_from(modes[at.MASS, 0], _mode(modes, 0), row, tau, states[0, at.Q], states[0, at.Q_RATE], others)


@kernel
def _mode(modes, i):
    """The system that one mode is."""
    return System(modes[at.MASS, i], 0.0, modes[at.STIFFNESS, i], modes[at.DAMPING, i], modes[at.WEIGHT, i], 0.0, None)


def _no_states(modes, y):
    return None


def _own_states(modes, y):
    return y[at.STATE_SIZE :].copy().reshape(-1, at.MODE_COLUMNS)


#: (modes, y) -> copy of the modes' part of a state (modes, MODE_COLUMNS); None where there is one mode.
states_of = chosen(_no_states, _own_states)


@kernel
def enter_states(states, y):
    """Enter the modes' part of a state."""
    if states is not None:
        y[at.STATE_SIZE :] = states.ravel()


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
def fastest_mode(modes):
    """Highest angular frequency of several modes [rad/s]; 0 where there is one."""
    if modes is None:
        return 0.0
    highest = 0.0
    for i in range(modes.shape[1]):
        highest = max(highest, modes[at.STIFFNESS, i] / modes[at.MASS, i])
    return math.sqrt(highest)


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
    return modes[2 * at.SET_ROWS + modes.shape[1] :]


def _arc(modes, y, mass, system, segment, tau):
    return arc_from(mass, system, segment, tau, y[at.BEAM], y[at.BEAM_VELOCITY])


def _free_arcs(modes, y, mass, system, segment, tau):
    return _arcs(modes, states_of(modes, y), segment, tau)


def _joined_arcs(modes, y, mass, system, segment, tau):
    return _arcs(modes[at.SET_ROWS :], to_joined(modes) @ states_of(modes, y), segment, tau)


#: (modes, y, mass, system, segment, tau) -> arc of the beam alone, whose `mass` is given [kg], from local time tau.
free_arc = chosen(_arc, _free_arcs)
#: The same of beam and grain as one mass.
joined_arc = chosen(_arc, _joined_arcs)


@kernel
def coordinates(modes, arc, tau):
    """Displacements and velocities (modes, 2) of the modes of an arc at local time tau."""
    found = np.empty((arc.others.shape[0] + 1, 2))
    found[0, 0], found[0, 1], _a, _u, _w = mode_at(arc, tau)
    for i in range(arc.others.shape[0]):
        found[i + 1, 0], found[i + 1, 1], _a, _u, _w = mode_at(other_arc(arc.others[i]), tau)
    return found


@kernel
def _enter_coordinates(y, found):
    states = y[at.STATE_SIZE :].reshape(-1, at.MODE_COLUMNS)
    states[:, at.Q], states[:, at.Q_RATE] = found[:, 0], found[:, 1]


@kernel
def leave_flight(modes, y, arc, tau):
    """Enter where a flight has led the modes."""
    if modes is not None:
        _enter_coordinates(y, coordinates(modes, arc, tau))


@kernel
def leave_joined(modes, y, arc, tau):
    """Enter where the motion with the grain held has led the modes."""
    if modes is not None:
        _enter_coordinates(y, from_joined(modes) @ coordinates(modes, arc, tau))


@kernel
def grain_acceleration(modes, system, segment, arc, tau, a):
    """Acceleration that the wall gives a grain held, its weight included [m/s^2]; a: of the container, in its arc.

    Of several modes it follows from the forces of springs and dampers, as in the flight that may come next: what the
    joined modes leave out of the damping would else let the grain leave and touch again without end.
    """
    if modes is None:
        return a + system.gravity
    u, w = support_at(segment, tau)
    apart = free_acceleration(modes, from_joined(modes) @ coordinates(modes, arc, tau), u, w)
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
