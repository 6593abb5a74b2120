# SPDX-License-Identifier: Apache-2.0
"""Complex Model of the PCA (thesis section 4.4): the soft-contact simulation, continued from height to height."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_control.selection.criteria import Verdict, judge
from atpid_control.selection.predictive import Impact, response_lag
from atpid_sim.engine import state
from atpid_sim.maps import Rig

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Samples a period from which velocities at impacts are read.
_SAMPLES = 128
_LOG = 4000

#: The grain starts this far above the floor, so that the impact begins in flight [m].
_JUST_ABOVE = 1e-9

#: How long an impact may last, in periods, and how finely its end is looked for.
_LONGEST_IMPACT, _SAMPLES_OF_IMPACT = 0.6, 600


@dataclass(frozen=True)
class Observed:
    """The observation of one height."""

    amplitude: float  # half peak-to-peak of the beam in the window [m]
    verdict: Verdict


class ComplexModel:
    """One simulation, continued while the ceiling is moved; times count from the first impact on the floor."""

    def __init__(self, rig: Rig, amplitude: float, t: float, start: Impact, height: float) -> None:
        """Begin with an impact on the floor at time t [s] of the Simplified Model."""
        self._rig, self._amplitude, self.height = rig, amplitude, height
        omega = 2.0 * math.pi * rig.frequency
        self._phase = omega * t + response_lag(rig.system, rig.frequency)
        beam = start.beam - rig.system.beam_mass * rig.system.gravity / rig.system.stiffness
        self._y, self._n = state.at_rest(beam, start.beam_velocity)
        self._y[state.GRAIN] += _JUST_ABOVE
        self._y[state.GRAIN_RATE] = start.grain_velocity
        self._y[state.FIRST_STEP] = 0.05
        self._n[state.MODE] = state.FREE
        self.evaluations = 0

    @property
    def time(self) -> float:
        """Where the simulation stands [s]."""
        return float(self._y[state.TIME])

    def next_floor_impact(self, periods: float) -> Impact | None:
        """Go on past the next upward and downward flight and return the end of the impact on the floor (Fig. 4.29).

        Where the grain meets the floor several times before it reaches the ceiling again, the last meeting counts: it
        is the one that throws it up. None, and no time passed, where within `periods` it does not come back.
        """
        y, n = self._y.copy(), self._n.copy()
        log = np.zeros((_LOG, state.COLUMNS))
        end = self.time + periods * self._rig.period
        self._advance(y, n, end, log=log)
        throw = _throw(log[: n[state.EVENTS]], self.time + 0.1 * self._rig.period)
        if throw is None:
            return None
        self._advance(self._y, self._n, throw)
        self._leave_floor()
        return self._impact()

    def observe(self, height: float, settle: float, window: float) -> Observed:
        """Move the ceiling to a height [m] within one period, wait for `settle` periods, observe `window` periods."""
        rig, begun = self._rig, self.time
        begin = begun + (1.0 + settle) * rig.period
        end = begin + window * rig.period
        path = ((begun, self.height), (begun + rig.period, height))
        out, log = np.zeros((state.ROWS, int(window * _SAMPLES))), np.zeros((_LOG, state.COLUMNS))
        self._rig.advance(
            self._amplitude, self._y, self._n, path, begin, end,
            phase=self._phase, out=out, rate=_SAMPLES * rig.frequency, log=log,
        )  # fmt: skip
        self.height = height
        self.evaluations += 1
        times = begin + np.arange(out.shape[1]) * rig.period / _SAMPLES
        impacts = log[: self._n[state.EVENTS]]
        longest = float(self._y[state.LONGEST])
        verdict = judge(impacts, times, out[state.S_RATE], longest, rig.period)
        return Observed(float(0.5 * (self._y[state.HIGHEST] - self._y[state.LOWEST])), verdict)

    def _advance(self, y: Array, n: Counts, end: float, **extra: Any) -> None:
        path = ((float(y[state.TIME]), self.height),)
        begin = float(y[state.TIME]) if "out" in extra else end
        self._rig.advance(self._amplitude, y, n, path, begin, end, phase=self._phase, **extra)

    def _leave_floor(self) -> None:
        """Go on until floor and grain no longer overlap, at most for the longest time an impact may last."""
        length = _LONGEST_IMPACT * self._rig.period
        out = np.zeros((state.ROWS, _SAMPLES_OF_IMPACT))
        self._advance(self._y.copy(), self._n.copy(), self.time + length, out=out, rate=_SAMPLES_OF_IMPACT / length)
        apart = np.flatnonzero(out[state.S_GRAIN] > out[state.S_BEAM])
        apart = apart[apart > 0]
        sample = int(apart[0]) if len(apart) else _SAMPLES_OF_IMPACT
        self._advance(self._y, self._n, self.time + sample * length / _SAMPLES_OF_IMPACT)

    def _impact(self) -> Impact:
        y, s = self._y, self._rig.system
        equilibrium = s.beam_mass * s.gravity / s.stiffness
        return Impact(float(y[state.BEAM]) + equilibrium, float(y[state.BEAM_RATE]), float(y[state.GRAIN_RATE]))


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
