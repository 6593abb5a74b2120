# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The models of the PCA (thesis section 4.4): Simplified and Predictive Model in closed form, Complex Model simulated.

Equations 4.7 to 4.32 are the closed forms; displacements are measured from the bare beam's equilibrium. In the thesis's
equation 4.11 m_b is m_g: the excitation is at the resonance of beam and grain together; here it is at whatever
frequency is given, which changes the beam's amplitude (`moving_mass`). The Complex Model is the soft-contact
simulation, continued from height to height, on whose impacts and trajectory the criteria of optimal grain motion
(equations 4.1 to 4.5) are judged.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns
from atpid_sim.engine.state import State
from atpid_sim.maps import DamperResponse
from atpid_sim.modal import modes_in, phasors, resting
from atpid_sim.simulation.integration import Observation, impact_log, sample_series
from atpid_sim.system import Array, System, structure_of

#: Halvings of half a period when the grain's return to the floor is sought.
_BISECTIONS = 60


@dataclass(frozen=True)
class Impact:
    """The moment after an impact on the floor, input of the Predictive Model."""

    beam: float  # displacement [m]
    beam_velocity: float  # [m/s]
    grain_velocity: float  # [m/s]


@dataclass(frozen=True)
class Simplified:
    """The beam's steady response x = A_pred sin(omega t) (equation 4.19)."""

    amplitude: float  # A_pred [m]
    omega: float  # of the excitation [rad/s]
    gravity: float  # [m/s^2]
    radius: float  # of the grain [m]

    @property
    def top_speed(self) -> float:
        """V_k0 of the first iteration (equation 4.25 at t_c1 = 0) [m/s]."""
        return self.omega * self.amplitude

    def displacement(self, t: float) -> float:
        """Displacement of the floor [m] at time t [s]."""
        return self.amplitude * math.sin(self.omega * t)

    def velocity(self, t: float) -> float:
        """Velocity of the floor [m/s] at time t [s]."""
        return self.top_speed * math.cos(self.omega * t)

    def height(self, floor: float, grain_velocity: float, t_floor: float, t_ceiling: float) -> float:
        """Return h_pred [m] for a grain that leaves the floor at `floor` [m] with `grain_velocity` [m/s] (eq. 4.29)."""
        flight = t_ceiling - t_floor
        risen = grain_velocity * flight - 0.5 * self.gravity * flight**2
        return 2.0 * self.radius + floor + risen - self.displacement(t_ceiling)

    def first_height(self) -> float:
        """Return the first guess [m]: floor struck at t = 0, ceiling half a period later, at top speed (eq. 4.30)."""
        return self.height(0.0, self.top_speed, 0.0, math.pi / self.omega)

    def next_height(self, last: Impact) -> float:
        """Return the next guess [m] from the end of the last impact on the floor (equations 4.31 and 4.32).

        Equation 4.32 is solved within a quarter of a period around t = 0; where the beam is further out than the
        Simplified Model ever goes, at the end of that range.
        """
        t_floor = math.asin(min(max(last.beam / self.amplitude, -1.0), 1.0)) / self.omega
        return self.height(last.beam, last.grain_velocity, t_floor, math.pi / self.omega)

    def first_return(self, height: float) -> tuple[float, Impact]:
        """Return when [s] and how a grain thrown down by the ceiling at `height` [m] meets the floor (Fig. 4.25).

        Beyond the ceiling the grain has the beam's velocity, as it had beyond the floor.
        """
        start = math.pi / self.omega
        clearance = height - 2.0 * self.radius

        def gap(t: float) -> float:
            fall = t - start
            return clearance - self.top_speed * fall - 0.5 * self.gravity * fall**2 - self.displacement(t)

        left, right = start, 2.0 * start
        while gap(right) > 0.0:
            right += start
        for _ in range(_BISECTIONS):
            middle = 0.5 * (left + right)
            left, right = (middle, right) if gap(middle) > 0.0 else (left, middle)
        return right, Impact(
            self.displacement(right), self.velocity(right), -self.top_speed - self.gravity * (right - start)
        )


def simplified(system: System, frequency: float, amplitude: float) -> Simplified:
    """Return the Simplified Model for a support amplitude [m] at a frequency [Hz] (equations 4.13 to 4.20)."""
    omega = 2.0 * math.pi * frequency
    if system.modes is not None:
        response = amplitude * abs(modal_response(system, frequency).sum())
        return Simplified(float(response), omega, system.gravity, system.radius)
    mass = moving_mass(system, frequency)
    natural = math.sqrt(system.stiffness / mass)
    decay = 0.5 * system.damping / mass
    force = amplitude * math.hypot(system.stiffness, system.damping * omega)
    stiffness = mass * math.hypot(2.0 * decay * omega, omega**2 - natural**2)
    return Simplified(force / stiffness, omega, system.gravity, system.radius)


def response_lag(system: System, frequency: float) -> float:
    """Return how far the Simplified Model's beam lags behind the support [rad].

    The thesis sets this phase to zero; the Complex Model needs the true one, or its first period is not a continuation.
    """
    if system.modes is not None:
        whole = complex(modal_response(system, frequency).sum())
        return -math.atan2(whole.imag, whole.real)
    omega = 2.0 * math.pi * frequency
    force = complex(system.stiffness, system.damping * omega)
    ratio = force / _resistance(system, moving_mass(system, frequency), omega)
    return -math.atan2(ratio.imag, ratio.real)


def modal_response(system: System, frequency: float) -> NDArray[np.complex128]:
    """Return the displacement of each mode (modes,) over the drive's amplitude: of `moving_mass` for several modes."""
    assert system.modes is not None
    modes = modes_in(system.modes)
    alone, closed = phasors(modes.free, frequency), modes.from_joined @ phasors(modes.joined, frequency)
    return min(alone, closed, key=lambda each: abs(each.sum()))


def equilibrium(system: System) -> float:
    """Return how far the structure's weight pulls it down without the grain [m], where displacements count from."""
    return -float(resting(structure_of(system, held=False)).sum())


def moving_mass(system: System, frequency: float) -> float:
    """Return the mass [kg] of which the Simplified Model is the response, (k + i c w) / (k - m w^2 + i c w).

    That of the bare beam, as in the thesis, whose equations hold at resonance of beam and grain. Above, towards its own
    resonance, the bare beam would swing without limit, and a damper leaves it less than the closed one: where beam and
    grain as one mass respond less, it is theirs.
    """
    omega, both = 2.0 * math.pi * frequency, system.beam_mass + system.grain_mass
    return max((system.beam_mass, both), key=lambda mass: abs(_resistance(system, mass, omega)))


def _resistance(system: System, mass: float, omega: float) -> complex:
    return complex(system.stiffness - mass * omega**2, system.damping * omega)


#: gamma of equation 4.5: a contact shorter than gamma/2 periods is no sticking.
GAMMA = 0.1
#: Equation 4.4 asks for impacts at the beam's top speed "or when its velocity decreases"; this share of it counts.
_NEAR_TOP = 0.5
#: Impacts closer together than this share of a period belong to one meeting.
_ONE_MEETING = 0.05


@dataclass(frozen=True)
class Criteria:
    """Which criteria of optimal grain motion hold."""

    floor_opposed: bool  # 4.1: on the floor the beam goes up and the grain comes down
    ceiling_opposed: bool  # 4.2: on the ceiling the reverse
    every_period: bool  # 4.3: both walls are struck in every period
    near_top_speed: bool  # 4.4: the beam is near its top speed at the impacts
    no_sticking: bool  # 4.5: contacts are short

    @property
    def broken(self) -> tuple[str, ...]:
        """Equation numbers of the criteria that do not hold."""
        return tuple(f"4.{number}" for number, holds in enumerate(vars(self).values(), start=1) if not holds)


def judge(impacts: Array, times: Array, velocities: Array, longest: float, period: float) -> Criteria:
    """Judge a window.

    impacts: (k, 3) time [s], wall (+1 floor, -1 ceiling), closing speed [m/s]; times, velocities: (n,) of the beam [s],
    [m/s]; longest: longest contact [s]; period: of the excitation [s].
    """
    inside = impacts[(impacts[:, 0] >= times[0]) & (impacts[:, 0] <= times[-1])]
    floor, ceiling = (_meetings(inside[inside[:, 1] == wall], period) for wall in (1.0, -1.0))
    if not len(floor) or not len(ceiling):
        return Criteria(False, False, False, False, longest < 0.5 * GAMMA * period)
    beam_floor, beam_ceiling = (np.interp(wall[:, 0], times, velocities) for wall in (floor, ceiling))
    top = float(np.max(np.abs(velocities)))
    gaps = (np.diff(np.concatenate([[times[0]], wall[:, 0], [times[-1]]])) for wall in (floor, ceiling))
    near = np.concatenate([beam_floor, -beam_ceiling]) >= _NEAR_TOP * top
    return Criteria(
        floor_opposed=bool(np.all((beam_floor > 0.0) & (beam_floor - floor[:, 2] < 0.0))),
        ceiling_opposed=bool(np.all((beam_ceiling < 0.0) & (beam_ceiling + ceiling[:, 2] > 0.0))),
        every_period=bool(max(map(np.max, gaps)) < 1.5 * period),
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


#: Samples a period from which velocities at impacts are read.
_SAMPLES = 128
_LOG = 4000
#: The grain starts this far above the floor, so that the impact begins in flight [m].
_JUST_ABOVE = 1e-9
#: How long an impact may last, in periods, and how finely its end is looked for.
_LONGEST_IMPACT, _SAMPLES_OF_IMPACT = 0.6, 600


class ComplexModel:
    """One simulation, continued while the ceiling is moved; times count from the first impact on the floor."""

    def __init__(self, damper: DamperResponse, amplitude: float, t: float, start: Impact, height: float) -> None:
        """Begin with an impact on the floor at time t [s] of the Simplified Model."""
        self._damper, self._amplitude, self.height = damper, amplitude, height
        omega = 2.0 * math.pi * damper.frequency
        self._phase = omega * t + response_lag(damper.system, damper.frequency)
        if damper.system.modes is None:
            self._state = State.resting(start.beam - equilibrium(damper.system), start.beam_velocity)
        else:
            turned = amplitude * modal_response(damper.system, damper.frequency) * np.exp(1j * self._phase)
            rest = resting(structure_of(damper.system, held=False))
            self._state = State.resting(0.0, 0.0, np.column_stack((turned.imag + rest, omega * turned.real)))
        self._state.y[columns.GRAIN] += _JUST_ABOVE
        self._state.y[columns.GRAIN_VELOCITY] = start.grain_velocity
        self._state.n[columns.MODE] = columns.FREE
        self.evaluations = 0

    @property
    def time(self) -> float:
        """Where the simulation stands [s]."""
        return self._state.time

    def next_floor_impact(self, periods: float) -> Impact | None:
        """Go on past the next upward and downward flight and return the end of the impact on the floor (Fig. 4.29).

        Where the grain meets the floor several times before it reaches the ceiling again, the last meeting counts: it
        is the one that throws it up. None, and no time passed, where within `periods` it does not come back.
        """
        state, log = self._state.copy(), impact_log(_LOG)
        end = self.time + periods * self._damper.period
        self._advance(state, Observation((end, end), impacts=log))
        throw = _throw(log[: state.n[columns.IMPACTS]], self.time + 0.1 * self._damper.period)
        if throw is None:
            return None
        self._advance(self._state, Observation((throw, throw)))
        self._leave_floor()
        now = self._state
        return Impact(now.beam + equilibrium(self._damper.system), now.beam_velocity, now.grain_velocity)

    def observe(self, height: float, settle: float, window: float) -> tuple[float, Criteria]:
        """Move the ceiling to a height [m] within one period, wait for `settle` periods, observe `window` periods.

        Return half the peak-to-peak of the beam in the window [m], and the verdict.
        """
        damper, begun = self._damper, self.time
        begin = begun + (1.0 + settle) * damper.period
        end = begin + window * damper.period
        path = ((begun, self.height), (begun + damper.period, height))
        samples, log = sample_series(int(window * _SAMPLES)), impact_log(_LOG)
        observation = Observation((begin, end), begin, 1.0 / (_SAMPLES * damper.frequency), samples, log)
        damper.advance(self._amplitude, self._state, path, observation, self._phase)
        self.height = height
        self.evaluations += 1
        times = begin + np.arange(samples.shape[1]) * damper.period / _SAMPLES
        impacts = log[: self._state.n[columns.IMPACTS]]
        longest = float(self._state.y[columns.LONGEST])
        return self._state.amplitude, judge(impacts, times, samples[columns.S_VELOCITY], longest, damper.period)

    def _advance(self, state: State, observation: Observation) -> None:
        self._damper.advance(self._amplitude, state, ((state.time, self.height),), observation, self._phase)

    def _leave_floor(self) -> None:
        """Go on until floor and grain no longer overlap, at most for the longest time an impact may last."""
        begin, length = self.time, _LONGEST_IMPACT * self._damper.period
        samples = sample_series(_SAMPLES_OF_IMPACT)
        spacing = 1.0 / (_SAMPLES_OF_IMPACT / length)
        self._advance(self._state.copy(), Observation((begin, begin + length), begin, spacing, samples))
        apart = np.flatnonzero(samples[columns.S_GRAIN] > samples[columns.S_BEAM])
        apart = apart[apart > 0]
        last = int(apart[0]) if len(apart) else _SAMPLES_OF_IMPACT
        end = begin + last * length / _SAMPLES_OF_IMPACT
        self._advance(self._state, Observation((end, end)))


def _throw(impacts: Array, since: float) -> float | None:
    """Return when [s] the grain, back from its first visit to the ceiling, last meets the floor before the next one."""
    late = impacts[impacts[:, 0] > since]
    ceilings = late[late[:, 1] < 0.0, 0]
    first = ceilings[0] if len(ceilings) else since
    floors = late[(late[:, 1] > 0.0) & (late[:, 0] > first), 0]
    if not len(floors):
        return None
    again = ceilings[ceilings > floors[0]]
    before = floors[floors < again[0]] if len(again) else floors[:1]
    return float(before[-1])
