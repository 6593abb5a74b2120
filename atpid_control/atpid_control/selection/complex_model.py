# SPDX-License-Identifier: Apache-2.0
"""Complex Model of the PCA (thesis section 4.4): the soft-contact simulation, continued from height to height."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from atpid_sim.engine import state
from atpid_sim.maps import Rig

from atpid_control.selection.criteria import Verdict, judge
from atpid_control.selection.predictive import Impact, response_lag

#: Samples a period from which velocities at impacts are read.
_SAMPLES = 128
_LOG = 4000

#: The grain starts this far above the floor, so that the impact begins in flight [m].
_JUST_ABOVE = 1e-9

#: How far the simulation goes between looks for the end of an impact, in periods; and how long an impact may last.
_LOOK, _LONGEST_IMPACT = 5e-4, 0.5


@dataclass(frozen=True)
class Observed:
    """What was seen at one height."""

    amplitude: float  # half peak-to-peak of the beam in the window [m]
    verdict: Verdict


class ComplexModel:
    """One simulation that goes on while the ceiling is moved; times count from the first impact on the floor."""

    def __init__(self, rig: Rig, amplitude: float, t: float, start: Impact, height: float) -> None:
        """Begin with an impact on the floor at time t [s] of the Simplified Model."""
        self._rig, self._amplitude, self.height = rig, amplitude, height
        omega = 2.0 * math.pi * rig.frequency
        self._phase = omega * t + response_lag(rig.system, rig.frequency)
        beam = start.beam - rig.system.beam_mass * rig.system.gravity / rig.system.stiffness
        self._y, self._n = state.at_rest(beam, start.beam_rate)
        self._y[state.GRAIN] += _JUST_ABOVE
        self._y[state.GRAIN_RATE] = start.grain_rate
        self._y[state.FIRST_STEP] = 0.05
        self._n[state.MODE] = state.FREE
        self.evaluations = 0

    @property
    def time(self) -> float:
        """Where the simulation stands [s]."""
        return float(self._y[state.TIME])

    def next_floor_impact(self, periods: float) -> Impact | None:
        """Go on past the next upward and downward flight and return the end of the impact on the floor (Fig. 4.29).

        None, and no time passed, where within `periods` none comes.
        """
        begun = self.time
        y, n = self._y.copy(), self._n.copy()
        log = np.zeros((_LOG, state.COLUMNS))
        end = begun + periods * self._rig.period
        self._advance(y, n, end, end, log=log)
        impacts = log[: n[state.EVENTS]]
        after_ceiling = np.flatnonzero(impacts[:, 1] < 0.0)
        first = after_ceiling[0] if len(after_ceiling) else 0
        floors = impacts[first:][(impacts[first:, 1] > 0.0) & (impacts[first:, 0] > begun + 0.1 * self._rig.period)]
        if not len(floors):
            return None
        self._advance(self._y, self._n, float(floors[0, 0]), float(floors[0, 0]))
        self._leave_floor()
        return self._impact()

    def observe(self, height: float, settle: float, window: float) -> Observed:
        """Move the ceiling to a height [m] within one period, let `settle` periods pass and watch `window` periods."""
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

    def _advance(self, y, n, begin: float, end: float, log=None) -> None:  # type: ignore[no-untyped-def]
        path = ((float(y[state.TIME]), self.height),)
        extra = {} if log is None else {"log": log}
        self._rig.advance(self._amplitude, y, n, path, begin, end, phase=self._phase, **extra)

    def _leave_floor(self) -> None:
        step = _LOOK * self._rig.period
        for _ in range(int(_LONGEST_IMPACT / _LOOK)):
            self._advance(self._y, self._n, self.time + step, self.time + step)
            if self._n[state.MODE] != state.ON_FLOOR:
                return

    def _impact(self) -> Impact:
        y, s = self._y, self._rig.system
        equilibrium = s.beam_mass * s.gravity / s.stiffness
        return Impact(
            float(y[state.BEAM]) + equilibrium, float(y[state.BEAM_RATE]), float(y[state.GRAIN_RATE])
        )
