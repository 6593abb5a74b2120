# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Predictive control algorithm (thesis section 4.4): guess a height, correct it by simulation, then tune it."""

import math
import time
from collections.abc import Callable
from contextlib import suppress

from atpid_control.selection.checks import response_at
from atpid_control.selection.pca_models import ComplexModel, simplified
from atpid_control.selection.protocol import Excitation, Selection, SelectionError, SelectionStage
from atpid_sim.maps import DamperResponse, Timing
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import efficiency

#: First step, as a share of the height, and how much smaller each change of direction makes it.
_SHARE, _DIVISOR = 0.10, 1.5
#: The search ends when successive heights change the amplitude by less than this share.
_DONE = 0.01
#: And no later than this many heights, or turns (the step is then half a percent): the thesis needed 16 heights.
_MOST, _TURNS = 24, 12

_Probe = Callable[[float], float]


def tune(probe: _Probe, height: float, amplitude: float, lowest: float, highest: float) -> tuple[float, float]:
    """Return the best height [m] and its amplitude [m], from a height whose amplitude [m] is known (Fig. 4.33).

    probe: height [m] to amplitude [m]. Down by a tenth until the amplitude grows, then up by a tenth / 1.5 until it
    grows, then by a tenth / (1.5 n), n one more at each turn, until successive heights differ by less than 1 % and
    neither is worse than the best by more.
    """
    best = last = (amplitude, height)
    direction, turns = -1.0, 0
    for _ in range(_MOST):
        share = _SHARE / (_DIVISOR * turns) if turns else _SHARE
        here = min(max(last[1] * (1.0 + direction * share), lowest), highest)
        if here == last[1]:
            direction, turns = -direction, turns + 1
            continue
        value = probe(here)
        best = min(best, (value, here))
        small = abs(value - last[0]) < _DONE * last[0] and value <= (1.0 + _DONE) * best[0]
        if turns > _TURNS or (turns >= 2 and small):
            break
        if value > last[0]:
            direction, turns = -direction, turns + 1
        last = (value, here)
    return best[1], best[0]


#: Iterations of Complex and Predictive Model before the last height is tuned whether the criteria hold or not.
_ITERATIONS = 6
#: Periods the grain gets to come back to the floor.
_RETURN = 4.0
#: Heights below this share of the ballistic clearance are nearly closed: guesses are limited to it.
_LEAST_SHARE = 0.1
#: Tolerance of the runs: 1 % of an amplitude is resolved.
_RTOL = 1e-4


_Start = tuple[float, float]  # amplitude of the beam [m], height [m]


class PcaSelector:
    """The thesis's algorithm; `stages` of the result shows every iteration."""

    method, simulates = "pca", True

    def __init__(self, scene: Scene, gravity: bool = True) -> None:
        """Take the system of a scene, and the ceiling's range where it is controlled.

        Without gravity all models are computed as if there were none (Fig. 4.43).
        """
        self._limits = scene.height_limits
        self._scene = scene if gravity else scene.with_(gravity=0.0)
        self._damper = DamperResponse(self._scene, _RTOL)
        with suppress(NumericalFailure):  # a first run, for its kernel's sake
            self._damper.opened(1e-6, 4.0 * self._damper.diameter, Timing(1.0, 4.0))

    def select(self, excitation: Excitation, margin: float = 0.0, height: float = math.nan) -> Selection:
        """Return the height for an excitation; see `HeightSelector.select`."""
        del height  # the algorithm begins with the closed damper, wherever the ceiling is
        begun = time.perf_counter()
        # the best height grows with the amplitude, so the lower end of the error bar is safe for all of it
        amplitude = excitation.amplitude
        used = amplitude - excitation.spread(margin)
        if used <= 0.0:
            bar = f"{margin:g} x {excitation.amplitude_std:g} {self._scene.driven_by.unit}"
            raise SelectionError(f"amplitude: its error bar ({bar}) reaches below 0")
        run = _Run(response_at(self._damper, self._scene, excitation.frequency, _RTOL), used, self._limits)
        try:
            best, observed = run.whole()
        except NumericalFailure as error:
            raise SelectionError(f"pca: {error}") from error
        reduction = efficiency(observed, run.damper.closed_amplitude(amplitude))
        found = best, observed, reduction, self.method, run.evaluations, time.perf_counter() - begun
        return Selection(*found, 0.0 if used == amplitude else math.nan, tuple(run.stages))


class _Run:
    """One run of the algorithm, with its stages."""

    def __init__(self, damper: DamperResponse, amplitude: float, limits: tuple[float, float]) -> None:
        self.damper, self.amplitude = damper, amplitude
        self.stages: list[SelectionStage] = []
        self.evaluations = self._tuned = 0
        unit, (low, high) = damper.ballistic_clearance(amplitude), limits
        self._highest = min(max(damper.diameter + unit, low), high)
        self._lowest = min(max(damper.diameter + _LEAST_SHARE * unit, low), self._highest)
        settle = damper.settling()
        self._settle, self._window = 0.6 * settle, 6.0

    def whole(self) -> tuple[float, float]:
        """Return the best height [m] and the beam's amplitude there [m]."""
        height = self._iterate()[1]
        least = self._opened(height)
        self._record("PCA", height, least, "before tuning, opened from closed")
        height, amplitude = tune(self._tuning, height, least, self._lowest, self._highest)
        final = self.damper.opened(self.amplitude, height, Timing(self.damper.settling(), 16.0)).amplitude
        self.evaluations += 1
        self._record("result", height, final, f"{amplitude:.5g} m while tuning")
        return height, final

    def _iterate(self) -> _Start:
        """Simplified and Predictive Model, then Complex and Predictive Model until the criteria hold.

        Guesses that change direction are taken half way: for heavy grains equation 4.31 otherwise alternates across
        the best height (docs/selection.md). Where the criteria never hold, the iteration with the least
        amplitude is what tuning starts from.
        """
        sm = simplified(self.damper.system, self.damper.frequency, self.amplitude)
        self._record("SM", math.nan, sm.amplitude, f"V = {sm.top_speed:.2f} m/s")
        guess = sm.first_height()
        self._record("SM + PM1", guess, math.nan, "first guess, equation 4.30")
        t, start = sm.first_return(max(guess, self._lowest))
        model = ComplexModel(self.damper, self.amplitude, t, start, self._within(guess))
        seen: list[_Start] = []
        before = model.height
        for iteration in range(1, _ITERATIONS + 1):
            impact = model.next_floor_impact(_RETURN)
            if impact is None:
                self._record(f"CM{iteration}", model.height, math.nan, "the grain does not come back to the floor")
                guess = model.height
            else:
                text = f"impact ends at {impact.beam:.4f} m, grain {impact.grain_velocity:.2f} m/s"
                self._record(f"CM{iteration}", model.height, math.nan, text)
                guess = sm.next_height(impact)
                if (guess - model.height) * (model.height - before) < 0.0:
                    guess = 0.5 * (guess + model.height)
            before = model.height
            amplitude, verdict = model.observe(self._within(guess), self._settle, self._window)
            self.evaluations += 1
            broken = ", ".join(verdict.broken)
            text = f"criteria {broken} do not hold" if broken else "all criteria hold"
            self._record(f"PM{iteration + 1} + CM{iteration + 1}", model.height, amplitude, text)
            seen.append((amplitude, model.height))
            if not broken:
                return seen[-1]
        return min(seen)

    def _opened(self, height: float) -> float:
        self.evaluations += 1
        return self.damper.opened(self.amplitude, height, Timing(self.damper.settling(), 8.0)).amplitude

    def _tuning(self, height: float) -> float:
        """Amplitude [m] at a height opened from closed: continuing from the last height would depend on the order."""
        amplitude = self._opened(height)
        self._tuned += 1
        self._record(f"tuning {self._tuned}", height, amplitude, "")
        return amplitude

    def _within(self, height: float) -> float:
        return min(max(height, self._lowest), self._highest)

    def _record(self, name: str, height: float, amplitude: float, note: str) -> None:
        self.stages.append(SelectionStage(name, height, amplitude, note))
