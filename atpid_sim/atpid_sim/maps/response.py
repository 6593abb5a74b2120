# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The response of a beam with its damper at a height, by the path on which the ceiling approached it."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from atpid_sim.engine import columns, drive
from atpid_sim.engine.response_run import EXCEEDED, Drive, Schedule, respond
from atpid_sim.engine.state import State
from atpid_sim.kernel_inputs import contact_of, restitution_of
from atpid_sim.modal import phasors, resting
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.periodic import Cliff, Conditions, find_cliff, periodic_motion
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import complete_fidelity, finite_error
from atpid_sim.simulation.integration import Integration, Observation, sample_series
from atpid_sim.system import System, reduced_mass, structure_of

Path = tuple[tuple[float, float], ...]
#: A reduction of the beam's amplitude below this is of no use: approach paths and model leave as much open [-].
LEAST_USE = 0.01
#: Frequencies over the natural one from which to which heights are selected [-].
LOWEST_RATIO, HIGHEST_RATIO = 0.5, 2.0
#: Period-to-period variation up to which a motion counts as regular [-].
_REGULAR = 0.02
#: Periods after which a regular motion repeats itself, at most, where grains rebound far.
REPEATS = 4
#: Tolerance of runs by which a regular motion is followed in height, the first step and the least, over the clearance.
_FOLLOWED_RTOL, _MOVED, _RESOLVED = 1e-8, 2e-3, 2e-4
#: Tolerance of runs with contacts from a table: finer ones change the amplitude by less than 2e-5
#: (docs/research/tradeoff.md).
_FINITE_RTOL = 1e-4


@dataclass(frozen=True)
class Timing:
    """Duration of one evaluation, in periods of the excitation."""

    settle: float  # from the end of the ceiling's travel to the window [periods]
    window: float  # in which the amplitude is taken [periods]
    repeats: int = 2  # periods after which a regular motion repeats itself, at most


@dataclass(frozen=True)
class EarlyEnd:
    """When a run may end before its time."""

    close: float = 0.0  # how near it has come to its steady motion, relative to the amplitude; 0: not before [-]
    limit: float = math.inf  # amplitude above which it need not be finished [m]


NEVER = EarlyEnd()


@dataclass(frozen=True)
class WindowResponse:
    """The beam's motion in a window."""

    amplitude: float  # half peak-to-peak [m]; of a run that ended early what it comes to
    variation: float  # largest change of the beam between periods of the same place in a cycle, over the amplitude [-]
    exceeded: bool = False  # the run ended early, since its amplitude exceeds the limit

    @property
    def regular(self) -> bool:
        """Whether the motion repeats: each period, each second one, or as `Timing.repeats` allows."""
        return self.variation <= _REGULAR


class DamperResponse:
    """A system at one excitation frequency; every call is a run of its own, safe from several threads.

    Raises NumericalFailure where a run does not end as it should.
    """

    def __init__(self, scene: Scene, rtol: float | None = None, fidelity: str | None = None) -> None:
        """Take beam, grain, contact, gravity and frequency from a scene; its ceiling and amplitude are not used.

        rtol: relative tolerance of the integrator, by default that of the scene. fidelity: by default the one that
        leaves out nothing of the contact law: near the best height a model error can change the motion altogether.
        """
        self._integration = Integration(scene, fidelity or complete_fidelity(scene), rtol)
        self._run = self._integration.kernel_inputs
        self.fidelity = self._integration.fidelity
        self.system: System = self._integration.system
        self._closed = structure_of(self.system, held=True)
        self.frequency = scene.frequency_hz
        self.period = 1.0 / self.frequency

    @cached_property
    def _finite(self) -> DamperResponse:
        return DamperResponse(self._integration.scene, max(self._integration.rtol, _FINITE_RTOL), "finite")

    def at_frequency(self, frequency: float) -> DamperResponse:
        """Return the response of the same system at another frequency of the excitation [Hz]."""
        other = copy(self)
        other.frequency, other.period = frequency, 1.0 / frequency
        return other

    def sufficient(self, amplitude: float, error: float) -> DamperResponse:
        """Return the response at the cheapest fidelity level whose model error is at most `error`, relative.

        amplitude: of the support [m]. That is `finite`, or this response itself where its error is larger; with an
        infinite error that is not computed.
        """
        if self.fidelity != "soft" or self.system.modes is not None:
            return self
        if error < math.inf:
            left_out = finite_error(self._integration.scene, self.closed_amplitude(amplitude), held=0.0)
            if left_out > error:
                return self
        return self._finite if self._finite.frequency == self.frequency else self._finite.at_frequency(self.frequency)

    @property
    def natural_frequency(self) -> float:
        """Natural frequency of beam and grain as one mass [Hz]."""
        return float(self._closed.frequencies[0])

    @property
    def diameter(self) -> float:
        """Height of the closed damper [m]."""
        return 2.0 * self.system.radius

    @property
    def decay_periods(self) -> float:
        """Time constant of the closed damper's free decay, in periods."""
        return 2.0 * float(self._closed.mass[0] / max(self._closed.damping[0], 1e-12)) * self.frequency

    def settling(self) -> float:
        """Return how many periods the transient of a change of height lasts: five time constants, from 24 to 240."""
        return min(max(5.0 * self.decay_periods, 24.0), 240.0)

    def closed_amplitude(self, amplitude: float) -> float:
        """Return the beam's steady amplitude with the damper closed [m]: beam and grain as one mass."""
        return float(abs(self._phasors(amplitude).sum()))

    def restitution(self, amplitude: float) -> float:
        """Return the restitution [-] of grain and container at the closed beam's greatest velocity."""
        speed = 2.0 * math.pi * self.frequency * self.closed_amplitude(amplitude)
        return restitution_of(contact_of(self._integration.scene), speed, reduced_mass(self.system))

    def closed_over_gravity(self, amplitude: float) -> float:
        """Return the closed beam's largest acceleration over gravity [-] at a support amplitude [m]; none: infinity."""
        acceleration = (2.0 * math.pi * self.frequency) ** 2 * self.closed_amplitude(amplitude)
        return acceleration / self.system.gravity if self.system.gravity > 0.0 else math.inf

    def rests(self, amplitude: float) -> bool:
        """Whether the grain stays on the floor when the closed damper is opened: at every height the beam is the same.

        It is lifted where the floor falls away faster than gravity; opening the ceiling exerts no force.
        """
        return self.closed_over_gravity(amplitude) <= 1.0

    def ballistic_clearance(self, amplitude: float) -> float:
        """Return the distance travelled in half a period at the grainless beam's peak velocity [m].

        That is the first guess of the PCA (thesis Eq. 4.30) less 2 r and the fall; best clearances lie at 0.4 to 0.9
        of it at every amplitude and mass of the grain. Above resonance, where the grainless beam swings more than the
        closed damper, the latter's velocity counts: a good damper leaves the beam less than either (docs/selection.md).
        """
        return math.pi * min(self.bare_amplitude(amplitude), self.closed_amplitude(amplitude))

    def bare_amplitude(self, amplitude: float) -> float:
        """Return the steady amplitude of the structure without the damper [m]; infinite where nothing bounds it."""
        return self._integration.scene.linear_amplitude(amplitude, self.frequency, grain=False)

    def _phasors(self, amplitude: float) -> NDArray[np.complex128]:
        """Return the steady response of each mode (modes,) with the grain held, against the drive's sine [m]."""
        found = phasors(self._closed, self.frequency, amplitude)
        if not np.isfinite(found).all():
            raise NumericalFailure("a beam without damping grows without limit at resonance; give it damping")
        return found

    def closed_state(self, amplitude: float) -> State:
        """Return the steady state of the closed damper at phase zero of the support's sine, grain on the floor.

        Without a ledger: nobody asks for one.
        """
        each, modes = self._phasors(amplitude), self._integration.scene.modes
        places, rates = each.imag + resting(self._closed), 2.0 * math.pi * self.frequency * each.real
        if modes is None:
            return State.resting(float(places[0]), float(rates[0])).without_ledger()
        return State.resting(0.0, 0.0, modes.from_joined @ np.column_stack((places, rates))).without_ledger()

    def follow(self, amplitude: float, path: Path, timing: Timing) -> WindowResponse:
        """Return the response in the window after the ceiling has followed the path ((t [s], h [m]), ...).

        The run starts in the closed damper's steady state at time zero, the ceiling at the path's first height.
        """
        strobe = sample_series(int(timing.window))
        begin = path[-1][0] + timing.settle * self.period
        state = self.closed_state(amplitude)
        window = begin, begin + timing.window * self.period
        self.advance(amplitude, state, path, Observation(window, begin, self.period, strobe))
        size, beam = state.amplitude, strobe[columns.S_BEAM]
        variation = max(float(np.ptp(beam[parity::2])) for parity in (0, 1)) / size if size > 0.0 else 0.0
        return WindowResponse(size, variation)

    def follow_on(
        self, amplitude: float, state: State, path: Path, timing: Timing, ending: EarlyEnd = NEVER
    ) -> WindowResponse:
        """Return the response from a state, which is advanced in place; the path begins at its time.

        One kernel, with no line of Python inside, which ends before its time where `ending` allows that. `follow` is
        the same run through a drive table; where the motion is irregular the two may differ. Raises NumericalFailure.
        """
        schedule = Schedule(float(timing.settle), float(timing.window), ending.close, ending.limit, timing.repeats)
        outcome, verdict, size, change = respond(
            self._run, Drive(float(amplitude), self.frequency), np.array(path, dtype=float), schedule, state.y, state.n
        )
        if outcome != Outcome.DONE:
            reason = Outcome(outcome).sentence
            raise NumericalFailure(f"{reason} {self._at(amplitude, path)}")
        return WindowResponse(size, change / size if size > 0.0 else 0.0, verdict == EXCEEDED)

    def _at(self, amplitude: float, path: Path) -> str:
        return f"(amplitude {amplitude:g} {self._integration.scene.driven_by.unit}, height {path[-1][1]:g} m)"

    def advance(self, amplitude: float, state: State, path: Path, observation: Observation, phase: float = 0.0) -> None:
        """Advance a state in place from its time to the end of the observation's window while the ceiling follows the
        path; the beam's range is taken anew in that window. phase: of the support's sine at time zero [rad].

        Raises NumericalFailure.
        """
        begin, end = observation.window
        rows = drive.harmonic_rows([(0.0, amplitude)], self.frequency, end)
        rows[:, columns.PHASE] += phase
        rows = drive.cut(drive.between(rows, state.time, end), [begin])
        state.restart_observation()
        outcome = self._integration.advance(state, drive.with_ceiling(rows, path), observation)
        if outcome != Outcome.DONE:
            raise NumericalFailure(f"{outcome.sentence} {self._at(amplitude, path)}")

    def cliff(self, amplitude: float, state: State, height: float, end: float) -> Cliff | None:
        """Return the regular motion near a simulated one, followed while the ceiling is moved to `end` [m] at most.

        state: of the simulated motion at a height [m]. None where no stable motion of at most four periods is near.
        """
        integration = self._integration.at_level(self.fidelity, _FOLLOWED_RTOL)
        conditions, clearance = Conditions(amplitude, self.frequency, height), height - self.diameter
        for periods in range(1, REPEATS + 1):
            motion = periodic_motion(integration, conditions, state, state.time * self.frequency % 1.0, periods).motion
            if motion is not None and motion.stability_margin > 0.0:
                return find_cliff(integration, motion, end, _MOVED * clearance, _RESOLVED * clearance)
        return None

    def opened(self, amplitude: float, height: float, timing: Timing, travel: float = 0.0) -> WindowResponse:
        """Return the response at a height [m] reached from the closed damper in `travel` seconds (0: at once)."""
        path = ((0.0, height),) if travel == 0.0 else ((0.0, self.diameter), (travel, height))
        return self.follow(amplitude, path, timing)
