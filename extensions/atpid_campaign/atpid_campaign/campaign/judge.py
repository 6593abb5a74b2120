# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Judges a point while it is measured: settled by the estimates and the beam's amplitude, not by a clock."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from atpid_campaign.campaign.plan import Rules
from atpid_common.vocabulary import EventKind, Quality, Severity
from atpid_control.identification import Estimate
from atpid_sim.system import Array

#: Periods in one look: the looks of a window share no samples.
_LOOK = 2.0
#: A ceiling this close to the height commanded has arrived [m]; one that a method moves stands at this [m].
ARRIVED, _STANDS = 5e-3, 2e-3
#: Standard deviations of an estimate that are no deviation.
_SIGMAS = 2.0
#: Ratio of von Neumann from which readings are independent, and the least scatter of a second half over the first's.
_RANDOM, _LASTING = 1.5, 0.7
#: Warnings that spoil a point whatever the estimates are; alarms do all.
SPOILING = frozenset({EventKind.FAULT, EventKind.DROPPED, EventKind.BEHIND, EventKind.TWO_TONES})
#: Alarms that are a result, not a fault of the stand.
_RESULTS = frozenset({EventKind.RUMBLE, EventKind.DRIFT, EventKind.STEP_BACK, EventKind.FALLBACK})


@dataclass
class Judge:
    """Takes each answered block; `begin` and `end` are the measurement's once it is over, `bad` why there is none.

    amplitude, frequency, height: of the point [m or N, Hz, m]; height None: a method selects it.
    """

    rules: Rules
    amplitude: float
    frequency: float
    height: float | None
    begin: float = math.nan  # [s]
    end: float = math.nan  # [s]
    bad: str = ""
    settled_after: float = math.nan  # [s]
    missing: str = "no estimate"  # what is not as it has to be
    heights: list[float] = field(default_factory=list)  # while measured [m]
    estimates: list[Estimate] = field(default_factory=list)  # while measured
    events: list[str] = field(default_factory=list)  # warnings and alarms of the point
    _first: float = math.nan
    _looks: deque[tuple[float, float, float]] = field(default_factory=deque)  # time [s], beam [m], height [m]

    @property
    def over(self) -> bool:
        """Whether nothing more is needed."""
        return bool(self.bad) or not math.isnan(self.end)

    @property
    def measuring(self) -> bool:
        """Whether the point has settled and is being measured."""
        return not math.isnan(self.begin) and not self.over

    def on_event(self, severity: int, kind: str, text: str) -> None:
        """Take an event of the graph."""
        if severity > Severity.INFO and not self.over:
            self.events.append(f"{kind}: {text}")
            if kind in SPOILING or (severity == Severity.ALARM and kind not in _RESULTS):
                self.bad = f"{kind}: {text}"

    def push(self, estimate: Estimate, height: float, moving: bool, recording: bool = True) -> None:
        """Take an estimate and where the ceiling is [m] then."""
        if self.over:
            return
        now = estimate.time
        self._first = now if math.isnan(self._first) else self._first
        wrong = self._wrong(estimate, height, moving) or ("" if recording else "the recorder has not begun")
        if self.measuring:
            self._measure(estimate, height, wrong)
            return
        self.missing = wrong or self._unsettled(now, estimate.beam_amplitude, height)
        if wrong:
            self._looks.clear()
        if not self.missing:
            self.begin, self.settled_after = now, now - self._first
        elif now - self._first > self.rules.settle_limit:
            self.bad = f"not settled within {self.rules.settle_limit:g} s: {self.missing}"

    def _measure(self, estimate: Estimate, height: float, wrong: str) -> None:
        if wrong:
            self.bad = f"while measured: {wrong}"
            return
        self.estimates.append(estimate)
        self.heights.append(height)
        if estimate.time - self.begin >= self.rules.measure_periods / self.frequency:
            self.end = estimate.time

    def _wrong(self, estimate: Estimate, height: float, moving: bool) -> str:
        """Return what is not as the point asks for; empty: all is."""
        # an excitation that is held is corrected now and then: while measured the rules' limits decide
        changing = self.measuring and estimate.quality == Quality.TRANSIENT
        if estimate.quality != Quality.STEADY and not changing:
            return f"the excitation is {Quality(estimate.quality).name.lower()}"
        if estimate.lost:
            return f"{estimate.lost} samples lost or saturated"
        for name, unit, value, std, given, share in (
            ("amplitude", "", estimate.amplitude, estimate.amplitude_std, self.amplitude, self.rules.amplitude),
            ("frequency", " Hz", estimate.frequency, estimate.frequency_std, self.frequency, self.rules.frequency),
        ):
            if abs(value - given) > share * given + _SIGMAS * std:
                return f"{name} {value:.5g}{unit}, wanted {given:.5g}{unit}"
        if not math.isfinite(height) or moving:
            return "the ceiling moves" if moving else "the ceiling's height is not known"
        if self.height is not None and abs(height - self.height) > ARRIVED:
            return f"the ceiling is at {height:.4f} m, wanted {self.height:.4f} m"
        return ""

    def _unsettled(self, now: float, beam: float, height: float) -> str:
        """Take a look at the beam; return why it has not settled yet, empty: it has."""
        looks = self._looks
        if not math.isfinite(beam):
            return "the beam is not measured"
        if looks and now - looks[-1][0] < _LOOK / self.frequency:
            return "settling"  # a new look decides
        looks.append((now, beam, height))
        if len(looks) * _LOOK < self.rules.settle_periods:
            return "settling"
        while len(looks) * _LOOK > self.rules.settle_periods + _LOOK:
            looks.popleft()
        beams, heights = np.array(looks).T[1:]
        if np.ptp(heights) > _STANDS:
            return "the ceiling does not stand"
        spread = np.ptp(beams) / beams.mean()
        if spread <= self.rules.drift or is_random(beams):
            return ""
        return f"the beam's amplitude changes by {100.0 * spread:.1f} %"


def is_random(readings: Array) -> bool:
    """Return whether readings (n,) scatter as an irregular motion does: a beat or a trend goes on from one to the next.

    By the ratio of von Neumann, 2 of independent readings and near 0 of a smooth curve, and by what the second half
    scatters beside the first: a beat dies out.
    """
    away, half = readings - readings.mean(), len(readings) // 2
    independent = np.sum(np.diff(readings) ** 2) >= _RANDOM * (away @ away)
    return bool(independent and readings[half:].std() >= _LASTING * readings[:half].std())
