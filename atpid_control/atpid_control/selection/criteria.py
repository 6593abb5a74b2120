# SPDX-License-Identifier: Apache-2.0
"""The criteria of optimal grain motion (thesis equations 4.1 to 4.5), judged on impacts and trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: gamma of equation 4.5: a contact shorter than gamma/2 periods is no sticking.
GAMMA = 0.1

#: Equation 4.4 asks for impacts at the beam's top speed "or when its velocity decreases"; this share of it counts.
_NEAR_TOP = 0.5

#: Impacts closer together than this share of a period belong to one meeting.
_ONE_MEETING = 0.05


@dataclass(frozen=True)
class Verdict:
    """Which criteria hold."""

    floor_opposed: bool  # 4.1: on the floor the beam goes up and the grain comes down
    ceiling_opposed: bool  # 4.2: on the ceiling the reverse
    every_period: bool  # 4.3: both walls are struck in every period
    near_top_speed: bool  # 4.4: the beam is near its top speed at the impacts
    no_sticking: bool  # 4.5: contacts are short

    @property
    def hold(self) -> bool:
        """Whether all criteria hold."""
        return not self.broken

    @property
    def broken(self) -> tuple[str, ...]:
        """Equation numbers of the criteria that do not hold."""
        names = ("4.1", "4.2", "4.3", "4.4", "4.5")
        values = (
            self.floor_opposed, self.ceiling_opposed, self.every_period, self.near_top_speed, self.no_sticking,
        )  # fmt: skip
        return tuple(name for name, value in zip(names, values, strict=True) if not value)


def judge(impacts: Array, times: Array, velocities: Array, longest: float, period: float) -> Verdict:
    """Judge a window.

    impacts: (k, 3) time [s], wall (+1 floor, -1 ceiling), closing speed [m/s]; times, velocities: (n,) of the beam [s],
    [m/s]; longest: longest contact [s]; period: of the excitation [s].
    """
    inside = impacts[(impacts[:, 0] >= times[0]) & (impacts[:, 0] <= times[-1])]
    floor, ceiling = (_meetings(inside[inside[:, 1] == wall], period) for wall in (1.0, -1.0))
    if not len(floor) or not len(ceiling):
        return Verdict(False, False, False, False, longest < 0.5 * GAMMA * period)
    beam_floor, beam_ceiling = (np.interp(wall[:, 0], times, velocities) for wall in (floor, ceiling))
    top = float(np.max(np.abs(velocities)))
    near = np.concatenate([beam_floor, -beam_ceiling]) >= _NEAR_TOP * top
    return Verdict(
        floor_opposed=bool(np.all((beam_floor > 0.0) & (beam_floor - floor[:, 2] < 0.0))),
        ceiling_opposed=bool(np.all((beam_ceiling < 0.0) & (beam_ceiling + ceiling[:, 2] > 0.0))),
        every_period=all(_every_period(wall[:, 0], times, period) for wall in (floor, ceiling)),
        near_top_speed=bool(np.all(near)),
        no_sticking=longest < 0.5 * GAMMA * period,
    )


def _meetings(impacts: Array, period: float) -> Array:
    """Return the first impact of each meeting with one wall: the small bounces after it are part of it."""
    if not len(impacts):
        return impacts
    apart = np.diff(impacts[:, 0]) > _ONE_MEETING * period
    first: Array = impacts[np.concatenate([[True], apart])]
    return first


def _every_period(at: Array, times: Array, period: float) -> bool:
    edges = np.concatenate([[times[0]], at, [times[-1]]])
    return bool(np.max(np.diff(edges)) < 1.5 * period)
