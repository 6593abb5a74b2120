# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ball on a shaking table: a scene whose stiff, heavy beam follows its support, begun on the periodic motion."""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, root

from atpid_sim.engine import columns
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.integration import Integration, Observation, impact_log
from atpid_sim.system import Array
from studies.theory.closed_forms import ShakingTable, doubling, onset

_RTOL, _GRAVITY, _FREQUENCY = 1e-12, 9.81, 5.0
#: The table: as stiff and damped as a scene allows [kg, N/m, N s/m], and a ball of the smallest share.
_MASS, _STIFFNESS, _DAMPING, _SHARE = 1e3, 1e12, 1e9, 1e-6
#: Changes of the ball's first height and speed for the return map's derivatives, in those of its flight.
_CHANGE = 1e-5
_OMEGA = 2.0 * math.pi * _FREQUENCY


class _Start(NamedTuple):
    """The ball at time zero."""

    height: float  # above the table [m]
    velocity: float  # [m/s]


class _Table(NamedTuple):
    """The table's motion, amplitude [m] and lag [rad] behind the support."""

    support: float  # amplitude of the support [m]
    amplitude: float
    lag: float

    def at(self, time: float) -> tuple[float, float]:
        """Return displacement from rest [m] and velocity [m/s]."""
        angle = _OMEGA * time - self.lag
        return self.amplitude * math.sin(angle), self.amplitude * _OMEGA * math.cos(angle)


def shaking_table(restitution: float, acceleration: float, periods: int = 300) -> dict[str, float | str]:
    """Return closing speed and multipliers of the motion of period one, and the accelerations at which it begins, ends.

    The motion is found by Newton's method on the simulated return map, and run over `periods`.
    """
    e = (restitution * _MASS - _ball_mass()) / (_MASS + _ball_mass())  # of an impact on a wall that cannot move
    table, start = _table(acceleration), _periodic(restitution, e, acceleration)
    impacts = _impacts(restitution, table, start, periods / _FREQUENCY)
    multiplier = _multipliers(restitution, table, start)[0]
    angle = _OMEGA * impacts[-1, columns.E_TIME] - table.lag
    return {
        "closing_speed": float(impacts[-1, columns.E_SPEED]),
        "closed_closing_speed": _GRAVITY / (_FREQUENCY * (1.0 + e)),
        "modulus": abs(multiplier),
        "closed_modulus": abs(ShakingTable(e, acceleration).multipliers[0]),
        "onset": acceleration * math.cos(angle),
        "closed_onset": onset(e),
        "doubling": _doubling(restitution, e),
        "closed_doubling": doubling(e),
    }  # fmt: skip


def _ball_mass() -> float:
    return _MASS * _SHARE / (1.0 - _SHARE)


def _table(acceleration: float) -> _Table:
    """Return the table's steady motion of an acceleration [g]: that of a beam on its moving support."""
    response = (_STIFFNESS + 1j * _DAMPING * _OMEGA) / (_STIFFNESS - _MASS * _OMEGA**2 + 1j * _DAMPING * _OMEGA)
    amplitude = acceleration * _GRAVITY / _OMEGA**2
    return _Table(amplitude / abs(response), amplitude, -float(np.angle(response)))


def _scene(restitution: float, table: _Table, start: _Start, duration: float) -> Scene:
    place, velocity = table.at(0.0)
    return standard_bench(
        beam={"mass": _MASS, "stiffness": _STIFFNESS, "damping": _DAMPING},
        grain={"mass_fraction": _SHARE, "radius": 0.0085}, contact={"law": "impact", "restitution": restitution},
        excitation={"amplitude": table.support, "frequency": _FREQUENCY}, ceiling={"height": 1e3}, gravity=_GRAVITY,
        duration=duration, steady_window=[0.0, duration],
        # the table rests under its own weight and the ball's, which it does not carry in flight
        initial={"displacement": place + _ball_mass() * _GRAVITY / _STIFFNESS, "velocity": velocity,
                 "grain_height": start.height, "grain_velocity": start.velocity},
    )  # fmt: skip


def _impacts(restitution: float, table: _Table, start: _Start, duration: float) -> Array:
    """Return the logged impacts (k, IMPACT_COLUMNS) of a run."""
    integration = Integration(_scene(restitution, table, start, duration), "impact", _RTOL)
    log = impact_log(int(3.0 * duration * _FREQUENCY) + 10)
    return integration.run(Observation((0.0, duration), impacts=log)).impacts


def _closed_start(e: float, acceleration: float) -> _Start:
    """Return the ball of the closed form at time zero, in flight."""
    table, period = _table(acceleration), 1.0 / _FREQUENCY
    left = (ShakingTable(e, acceleration).phase + table.lag) / _OMEGA - period  # when it last left the table
    speed = 0.5 * _GRAVITY * period
    place = table.at(left)[0] + speed * -left - 0.5 * _GRAVITY * left**2
    return _Start(place - table.at(0.0)[0], speed + _GRAVITY * left)


def _map(restitution: float, table: _Table, start: _Start) -> Array:
    """Return instant less period [s] and closing speed [m/s] of the first two impacts (2, 2)."""
    found = _impacts(restitution, table, start, 2.5 / _FREQUENCY)[:2][:, [columns.E_TIME, columns.E_SPEED]]
    return np.asarray(found - np.array([[0.0, 0.0], [1.0 / _FREQUENCY, 0.0]]))


def _periodic(restitution: float, e: float, acceleration: float) -> _Start:
    """Return the ball of the periodic motion, by Newton's method on the simulated map from the closed form."""
    table, guess = _table(acceleration), _closed_start(e, acceleration)

    def change(scaled: Array) -> Array:
        first, second = _map(restitution, table, _Start(*(scaled * guess)))
        return np.asarray((second - first) / np.array([1.0 / _FREQUENCY, _GRAVITY / _FREQUENCY]))

    return _Start(*(root(change, np.ones(2), options={"xtol": 1e-13, "eps": 1e-9}).x * guess))


def _multipliers(restitution: float, table: _Table, start: _Start) -> Array:
    """Return the multipliers (2,) of the return map at a periodic motion, the largest first, by central differences."""
    columns_first, columns_second = [], []
    for changed in np.diag(np.full(2, _CHANGE)):
        above, below = (_map(restitution, table, _Start(*(np.array(start) * (1.0 + sign * changed))))
                        for sign in (1.0, -1.0))  # fmt: skip
        columns_first.append(above[0] - below[0])
        columns_second.append(above[1] - below[1])
    found = np.linalg.eigvals(np.linalg.solve(np.array(columns_first), np.array(columns_second)))
    return np.asarray(found[np.argsort(-np.abs(found))])


def _doubling(restitution: float, e: float) -> float:
    """Return the acceleration [g] at which a multiplier of the simulated return map is -1."""

    def beyond(acceleration: float) -> float:
        start = _periodic(restitution, e, acceleration)
        first, second = _multipliers(restitution, _table(acceleration), start)
        return float(((1.0 + first) * (1.0 + second)).real)  # the characteristic polynomial at -1

    expected = doubling(e)
    return float(brentq(beyond, 0.97 * expected, 1.03 * expected, xtol=1e-12))
