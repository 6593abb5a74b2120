# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact forces at the ceiling and the floor in the steady motion, by the contact law along a `soft` run, and the
sound that the grain radiates under them."""

import math
from dataclasses import dataclass

import numpy as np

from atpid_design.problem import Case
from atpid_sim.engine import columns
from atpid_sim.maps.ratings import at_once
from atpid_sim.simulation.integration import Observation, impact_log, sample_series
from atpid_sim.system import Array, System, reduced_mass

#: Samples in the duration of a Hertzian impact, and the most of a run.
_IN_CONTACT, _MOST = 80, 2_000_000
#: Periods in which forces are taken, and impacts logged at most.
_PERIODS, _LOG = 8, 4_000
#: Density [kg/m^3] and speed of sound [m/s] of air at 20 °C.
_AIR, _SOUND = 1.204, 343.2


@dataclass(frozen=True)
class Forces:
    """Largest contact forces, overlap and impacts in a window of the steady motion."""

    ceiling: float  # largest force on the ceiling [N]
    floor: float  # largest force on the floor [N]
    overlap: float  # deepest, at either wall [m]
    speed: float  # largest closing speed of an impact on the ceiling [m/s]
    impulse: float  # mean force on the ceiling over the rate of its impacts [N s]
    rate: float  # impacts on the ceiling [1/s]
    mean: float  # mean force on the ceiling [N]
    sound_power: float  # of the grain as a sphere in free air [W]


def forces(one: Case, amplitude: float, height: float) -> Forces:
    """Return the contact forces of a case after the ceiling has opened to a commanded height [m].

    amplitude: identified, of the support [m]. The force is that of the law at the overlap and its velocity, sampled 80
    times in the duration of an impact. Raises NumericalFailure.
    """
    damper, true = one.damper, one.amplitude(amplitude)
    begin = (damper.settling() + 16.0) * damper.period
    end = begin + _PERIODS * damper.period
    speed = 2.0 * math.pi * damper.frequency * damper.closed_amplitude(true)
    lasts = contact_time(damper.system, float(one.contact.parameters[0]), speed)
    step = max(lasts / _IN_CONTACT, (end - begin) / _MOST)
    samples, log = sample_series(int((end - begin) / step)), impact_log(_LOG)
    state = damper.closed_state(true)
    path = at_once(damper, one.height(height), 0.0)
    damper.advance(true, state, path, Observation((begin, end), begin, step, samples, log))
    seen = samples[:, : state.n[columns.SAMPLE]]
    floor_overlap = seen[columns.S_BEAM] - seen[columns.S_GRAIN]
    ceiling_overlap = damper.diameter - floor_overlap - seen[columns.S_CEILING]
    floor, ceiling = (law_force(overlap, step, one.contact.parameters) for overlap in (floor_overlap, ceiling_overlap))
    hits = log[: state.n[columns.IMPACTS]]
    hits = hits[(hits[:, columns.E_WALL] < 0.0) & (hits[:, columns.E_TIME] >= begin)]
    rate = len(hits) / (end - begin)
    mean = float(ceiling.mean())
    return Forces(
        ceiling=float(ceiling.max(initial=0.0)),
        floor=float(floor.max(initial=0.0)),
        overlap=float(max(floor_overlap.max(), ceiling_overlap.max(), 0.0)),
        speed=float(hits[:, columns.E_SPEED].max(initial=0.0)),
        impulse=mean / rate if rate > 0.0 else 0.0,
        rate=rate,
        mean=mean,
        sound_power=sound_power((floor - ceiling) / damper.system.grain_mass, step, damper.system.radius),
    )


def law_force(overlap: Array, step: float, parameters: Array) -> Array:
    """Return the force of Tsuji's law (n,) [N] at an overlap (n,) [m] sampled every `step` [s] (Eqs 3.12, 3.24).

    parameters: k [N/m^1.5] and c [N s/m^1.25] first. 0 without overlap, and never negative.
    """
    pushed = np.maximum(overlap, 0.0)
    force = parameters[0] * pushed**1.5 + parameters[1] * np.gradient(overlap, step) * pushed**0.25
    return np.asarray(np.maximum(force, 0.0))


def sound_power(acceleration: Array, step: float, radius: float) -> float:
    """Return the mean sound power [W] of a rigid sphere in free air, its acceleration (n,) [m/s^2] known every `step`.

    An oscillating sphere is a dipole with the radiation resistance (4/3) pi r^2 rho c x^4 / (4 + x^4), x = omega r / c
    (Koss, J. Sound Vib. 36, 1974, 541, for impacts); here over the spectrum of the velocity. A change of velocity dv
    within less than r / c radiates most, the kinetic energy of the entrained air, 1/4 rho V dv^2 (Taylor 1942;
    Richards, Westcott and Jeyapalan, J. Sound Vib. 62, 1979).
    """
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(acceleration), step)[1:]
    fourth = (omega * radius / _SOUND) ** 4
    resistance = 4.0 / 3.0 * np.pi * radius**2 * _AIR * _SOUND * fourth / (4.0 + fourth)
    velocity = np.fft.rfft(acceleration)[1:] / (omega * len(acceleration))
    return float(2.0 * np.sum(resistance * np.abs(velocity) ** 2))


def contact_time(system: System, stiffness: float, speed: float) -> float:
    """Return the duration of an elastic impact after Hertz [s]: 2.94 times its depth over its speed [m/s].

    The depth follows from the kinetic energy of the reduced mass, 2/5 k depth^2.5 = 1/2 m v^2, k = `stiffness`
    [N/m^1.5].
    """
    depth = (1.25 * reduced_mass(system) * speed**2 / stiffness) ** 0.4
    return float(2.943 * depth / speed)
