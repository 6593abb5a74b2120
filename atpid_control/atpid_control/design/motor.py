# SPDX-License-Identifier: Apache-2.0
"""The motor that moves the ceiling: speed, force, torque, and how often it is struck.

The rules. **Speed**: the excitation steps from one end of the amplitudes to the other, or is switched on; the beam
follows with the time constant of the closed damper, tau = 2 M / c, and the ceiling has to keep up with it: |h'| =
max(dh/dA) (A_hi - A_lo) / tau with the steepest slope of height over amplitude, and (h_hi - 2 r) / tau at least.
**Force**: what holds the ceiling bears the largest contact force of all corners at all amplitudes; the torque of the
drive is that force times its lever. A drive that does not move back under load (a screw) bears it in the screw, and its
motor only overcomes the mean force of the impacts while it closes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from atpid_control.design.problem import Problem, grain_radius, time_constant
from atpid_control.design.promise import Point

#: Ceiling velocity over the closing speed of impacts, above which a travel changes the impacts themselves [-].
FAST = 0.2


@dataclass(frozen=True)
class Motor:
    """What the ceiling's motor has to do."""

    speed: float  # [m/s]
    travel: float  # from the least to the largest height [m]
    time_constant: float  # of the closed damper [s]
    force: float  # largest contact force on the ceiling [N]
    lever: float  # [m]
    torque: float  # force times lever [N m]
    mean_force: float  # of the impacts, largest over the amplitudes [N]
    impact_rate: float  # impacts on the ceiling, largest over the amplitudes [1/s]
    impulse: float  # of one impact, largest over the amplitudes [N s]
    speed_ratio: float  # speed over the largest closing speed of an impact [-]


def motor(problem: Problem, fraction: float, points: Sequence[Point]) -> Motor:
    """Return the motor for the design at rising amplitudes; see the rules of this module."""
    amplitudes, heights = (np.array([getattr(one, name) for one in points]) for name in ("amplitude", "height"))
    tau = time_constant(problem, fraction)
    slope = float(np.max(np.abs(np.diff(heights) / np.diff(amplitudes))))
    opening = float(heights.max()) - 2.0 * grain_radius(problem, fraction)
    speed = max(slope * float(amplitudes[-1] - amplitudes[0]), opening) / tau
    force = max(one.ceiling_force.high for one in points)
    closing = max(one.speed for one in points)
    return Motor(
        speed=speed,
        travel=float(heights.max() - heights.min()),
        time_constant=tau,
        force=force,
        lever=problem.lever,
        torque=force * problem.lever,
        mean_force=max(one.mean_force for one in points),
        impact_rate=max(one.rate for one in points),
        impulse=max(one.impulse for one in points),
        speed_ratio=speed / closing if closing > 0.0 else 0.0,
    )
