# SPDX-License-Identifier: Apache-2.0
"""One beam with its damper, run again and again: how large it swings at a height, by the way the ceiling got there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_sim.contact import contact_of
from atpid_sim.contact.ids import IMPACT
from atpid_sim.engine import drive, state
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.run import Stepper, stepper_of
from atpid_sim.scene import Scene
from atpid_sim.system import System, system_of

Array = NDArray[np.float64]
Path = tuple[tuple[float, float], ...]

#: First step of a first contact, as the fourth root of a time [s^(1/4)].
_FIRST_STEP = 0.05
_BUDGET = 5_000_000

#: Unrest up to which a motion counts as regular [-].
_REGULAR = 0.02

_NO_SAMPLES = np.zeros((state.ROWS, 0))
_NO_LOG = np.zeros((0, state.COLUMNS))


@dataclass(frozen=True)
class Timing:
    """How long one evaluation runs, in periods of the excitation."""

    settle: float  # from the moment the ceiling stands until the window [periods]
    window: float  # in which the amplitude is taken [periods]


@dataclass(frozen=True)
class Response:
    """What the beam did in a window."""

    amplitude: float  # half peak-to-peak [m]
    unrest: float  # largest change of the beam between periods of the same parity, over the amplitude [-]

    @property
    def regular(self) -> bool:
        """Whether the motion repeats, each period or each second one."""
        return self.unrest <= _REGULAR


class Rig:
    """A system at one excitation frequency; every call is a run of its own, safe from several threads.

    Raises NumericalFailure where a run does not end as it should.
    """

    def __init__(self, scene: Scene, rtol: float) -> None:
        """Take beam, grain, contact, gravity and frequency from a scene, whatever it says of ceiling and amplitude."""
        law = contact_of(scene).law
        self.system: System = system_of(scene)
        self.frequency = scene.frequency_hz
        self.period = 1.0 / self.frequency
        self._run: Stepper = stepper_of(scene, "impact" if law == IMPACT else "soft", rtol)

    @property
    def diameter(self) -> float:
        """Height of the closed damper [m]."""
        return 2.0 * self.system.radius

    @property
    def decay_periods(self) -> float:
        """Time constant of the closed damper's free decay, in periods."""
        s = self.system
        return 2.0 * (s.beam_mass + s.grain_mass) / max(s.damping, 1e-12) * self.frequency

    def settling(self) -> float:
        """Return how many periods a change of height needs to die out: five time constants, within reason."""
        return min(max(5.0 * self.decay_periods, 24.0), 240.0)

    def closed_amplitude(self, amplitude: float) -> float:
        """Return the beam's steady amplitude with the damper closed [m]: beam and grain as one mass."""
        return abs(self._phasor(amplitude))

    def ballistic_clearance(self, amplitude: float) -> float:
        """Return the distance travelled in half a period at the grainless beam's peak velocity [m].

        That is the first guess of the PCA (thesis Eq. 4.30) less 2 r and the fall; best clearances lie at 0.4 to 0.9
        of it, whatever the amplitude and the grain's mass.
        """
        s, w = self.system, 2.0 * math.pi * self.frequency
        bare = (
            amplitude
            * abs(complex(s.stiffness, s.damping * w))
            / abs(complex(s.stiffness - s.beam_mass * w * w, s.damping * w))
        )
        return math.pi * bare

    def _phasor(self, amplitude: float) -> complex:
        s, w = self.system, 2.0 * math.pi * self.frequency
        mass = s.beam_mass + s.grain_mass
        drive_force = complex(s.stiffness, s.damping * w) * amplitude
        return drive_force / complex(s.stiffness - mass * w * w, s.damping * w)

    def closed_state(self, amplitude: float) -> tuple[Array, NDArray[np.int64]]:
        """Return the steady state of the closed damper at phase zero of the support's sine, grain on the floor."""
        s, w = self.system, 2.0 * math.pi * self.frequency
        swing = self._phasor(amplitude)
        y, n = state.at_rest(swing.imag - (s.beam_mass + s.grain_mass) * s.gravity / s.stiffness, w * swing.real)
        y[state.FIRST_STEP] = _FIRST_STEP
        return y, n

    def follow(self, amplitude: float, path: Path, timing: Timing) -> Response:
        """Return what the beam does in the window after the ceiling went the path ((t [s], h [m]), ...).

        The run starts in the closed damper's steady state at time zero, the ceiling at the path's first height.
        """
        strobe = np.zeros((state.ROWS, int(timing.window)))
        y, _ = self.carry(amplitude, path, timing, strobe)
        size = float(0.5 * (y[state.HIGHEST] - y[state.LOWEST]))
        beam = strobe[state.S_BEAM]
        unrest = max(float(np.ptp(beam[parity::2])) for parity in (0, 1)) / size if size > 0.0 else 0.0
        return Response(size, unrest)

    def carry(
        self, amplitude: float, path: Path, timing: Timing, out: Array = _NO_SAMPLES, log: Array = _NO_LOG
    ) -> tuple[Array, NDArray[np.int64]]:
        """As `follow`, but return the last state; fill `out` (6, n) once a period, `log` (capacity, 3) with impacts."""
        begin = path[-1][0] + timing.settle * self.period
        end = begin + timing.window * self.period
        y, n = self.closed_state(amplitude)
        self.advance(amplitude, y, n, path, begin, end, out=out, log=log)
        return y, n

    def advance(
        self,
        amplitude: float,
        y: Array,
        n: NDArray[np.int64],
        path: Path,
        begin: float,
        end: float,
        *,
        phase: float = 0.0,
        out: Array = _NO_SAMPLES,
        rate: float = 0.0,
        log: Array = _NO_LOG,
    ) -> None:
        """Carry a state (`engine.state`) from its time to `end` [s] while the ceiling goes the path, in place.

        The beam's range is taken afresh from `begin` [s] on, where samples begin too, at `rate` [Hz], 0: one a period.
        phase: of the support's sine at time zero [rad]. Raises NumericalFailure.
        """
        rows = drive.harmonic_rows([(0.0, amplitude)], self.frequency, end)
        rows[:, drive.PHASE] += phase
        rows = drive.cut(drive.between(rows, float(y[state.TIME]), end), [begin])
        y[state.LOWEST], y[state.HIGHEST], y[state.LONGEST] = np.inf, -np.inf, 0.0
        n[[state.SAMPLE, state.EVENTS]] = 0
        spacing = 1.0 / rate if rate > 0.0 else self.period
        outcome = self._run(drive.with_ceiling(rows, path), y, n, (begin, end), (begin, spacing), out, log, _BUDGET)
        if outcome != Outcome.DONE:
            raise NumericalFailure(f"{Outcome(outcome).sentence} (amplitude {amplitude:g} m, height {path[-1][1]:g} m)")

    def opened(self, amplitude: float, height: float, timing: Timing, travel: float = 0.0) -> Response:
        """Return the response at a height [m] reached from the closed damper in `travel` seconds (0: at once)."""
        path = ((0.0, height),) if travel == 0.0 else ((0.0, self.diameter), (travel, height))
        return self.follow(amplitude, path, timing)
