# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor that moves the ceiling: speed, force, torque, and how often it is struck.

The rules. **Speed**: the excitation steps from one end of the amplitudes to the other, or is switched on; the beam
follows with the time constant of the closed damper, tau = 2 M / c, and the ceiling has to keep up with it: |h'| =
max(dh/dA) (A_hi - A_lo) / tau with the steepest slope of height over amplitude, and (h_hi - 2 r) / tau at least.
**Force**: what holds the ceiling bears the largest contact force of all corners at all amplitudes; the torque of the
drive is that force times its lever. A drive that does not move back under load (a screw) bears it in the screw, and its
motor only overcomes the mean force of the impacts while it closes. **Screw**: the smallest usual lead at which a motor
of the stated speed needs no gear that makes it faster; power is the mean force times the speed over the screw's
efficiency. **Contact**: the peak pressure of Hertz's contact under the largest force, and the yield strength from which
nothing yields below the surface (Johnson, Contact Mechanics, 1985, sections 4.2 and 6.1: p_0 = 1.60 Y). **Noise**: the
sound power of the grain alone.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from atpid_design.problem import POISSON, Problem, grain_radius, time_constant
from atpid_design.worst_case import Point

#: Ceiling velocity over the closing speed of impacts, above which a travel changes the impacts themselves [-].
FAST = 0.2
#: Leads of screws that are sold [m], and the efficiency of one that does not move back [-].
_LEADS, SCREW_EFFICIENCY = (1.5e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3, 8e-3, 1e-2, 1.2e-2, 1.6e-2, 2e-2, 2.5e-2), 0.3
#: Peak pressure over yield strength at which yield begins [-].
YIELD_BEGINS = 1.6
_DAY = 86_400.0


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
    floor_force: float  # largest contact force on the floor [N]
    motor_speed: float  # of the motor, as stated [1/min]
    lead: float  # of the screw [m]
    gear: float  # turns of the motor for one of the screw [-]
    screw_torque: float  # on the screw, against the mean force of the impacts [N m]
    power: float  # the same at the speed of the ceiling [W]
    travel_time: float  # over all heights at that speed [s]
    height_error: float  # of the position, that costs two points of the reduction at one of the amplitudes [m]
    pressure: float  # peak of Hertz's contact under the largest force of both walls [Pa]
    yield_strength: float  # from which nothing yields under it [Pa]
    impacts_a_day: float
    sound_power_level: float  # of the grain in free air, largest over the amplitudes [dB re 1 pW]


def motor(problem: Problem, fraction: float, points: Sequence[Point]) -> Motor:
    """Return the motor for the design at rising amplitudes; see the rules of this module."""
    amplitudes, heights = (np.array([getattr(one, name) for one in points]) for name in ("amplitude", "height"))
    tau = time_constant(problem, fraction)
    slope = float(np.max(np.abs(np.diff(heights) / np.diff(amplitudes))))
    opening = float(heights.max()) - 2.0 * grain_radius(problem, fraction)
    speed = max(slope * float(amplitudes[-1] - amplitudes[0]), opening) / tau
    force = max(one.ceiling_force.high for one in points)
    closing, mean = (max(getattr(one, name) for one in points) for name in ("speed", "mean_force"))
    rate, floor, sound = (max(getattr(one, name) for one in points) for name in ("rate", "floor_force", "sound_power"))
    turns = problem.motor_speed / 60.0
    lead = next((one for one in _LEADS if one * turns >= speed), _LEADS[-1])
    pressure = peak_pressure(problem, max(force, floor), grain_radius(problem, fraction))
    return Motor(
        speed=speed,
        travel=float(heights.max() - heights.min()),
        time_constant=tau,
        force=force,
        lever=problem.lever,
        torque=force * problem.lever,
        mean_force=mean,
        impact_rate=rate,
        impulse=max(one.impulse for one in points),
        speed_ratio=speed / closing if closing > 0.0 else 0.0,
        floor_force=floor,
        motor_speed=problem.motor_speed,
        lead=lead,
        gear=turns * lead / speed if speed > 0.0 else math.inf,
        screw_torque=mean * lead / (2.0 * math.pi * SCREW_EFFICIENCY),
        power=mean * speed / SCREW_EFFICIENCY,
        travel_time=float(np.ptp(heights)) / speed if speed > 0.0 else 0.0,
        height_error=min(one.height_error for one in points),
        pressure=pressure,
        yield_strength=pressure / YIELD_BEGINS,
        impacts_a_day=_DAY * rate,
        sound_power_level=10.0 * math.log10(sound / 1e-12) if sound > 0.0 else -math.inf,
    )


def peak_pressure(problem: Problem, force: float, radius: float) -> float:
    """Return the pressure [Pa] in the middle of Hertz's contact of a grain of a radius [m] on a flat wall, force [N].

    p_0 = (6 F E*^2 / (pi^3 R^2))^(1/3), E* = E / (2 (1 - nu^2)) as in the contact law.
    """
    modulus = problem.young_modulus / (2.0 * (1.0 - POISSON**2))
    return float(np.cbrt(6.0 * force * modulus**2 / (math.pi**3 * radius**2)))
