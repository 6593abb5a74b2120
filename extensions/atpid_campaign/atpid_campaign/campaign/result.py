# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a point was measured to be, from its bag, and what simulation of the same point gives; both with error bars."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from atpid_campaign.campaign.plan import Campaign, Point, Rules, from_rest
from atpid_common.files import Document
from atpid_common.vocabulary import EventKind, Quality, Severity
from atpid_control.identification import Estimate
from atpid_control.runs.run import open_run
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic import steady_state
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import amplitudes_per_period
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

#: Periods in one look: the looks of a window share no samples.
_LOOK = 2.0
#: A ceiling this close to the height commanded has arrived [m]; one that a method moves stands at this [m].
_ARRIVED, _STANDS = 5e-3, 2e-3
#: Standard deviations of an estimate that are no deviation.
_SIGMAS = 2.0
#: Ratio of von Neumann from which readings are independent, and the least scatter of a second half over the first's.
_RANDOM, _LASTING = 1.5, 0.7
#: Warnings that spoil a point whatever the estimates are; alarms do all.
_SPOILING = frozenset({EventKind.FAULT, EventKind.DROPPED, EventKind.BEHIND, EventKind.TWO_TONES})
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
            if kind in _SPOILING or (severity == Severity.ALARM and kind not in _RESULTS):
                self.bad = f"{kind}: {text}"

    def push(self, estimate: Estimate, height: float, moving: bool, recording: bool = True) -> None:
        """Take an estimate and where the ceiling is [m] then."""
        if self.over:
            return
        now = estimate.time
        self._first = now if math.isnan(self._first) else self._first
        wrong = self._wrong(estimate, height, moving) or ("" if recording else "the recorder has not begun")
        if self.measuring:
            self.bad = f"while measured: {wrong}" if wrong else ""
            if not wrong:
                self.estimates.append(estimate)
                self.heights.append(height)
                self.end = now if now - self.begin >= self.rules.measure_periods / self.frequency else self.end
            return
        self.missing = wrong or self._unsettled(now, estimate.beam_amplitude, height)
        if wrong:
            self._looks.clear()
        if not self.missing:
            self.begin, self.settled_after = now, now - self._first
        elif now - self._first > self.rules.settle_limit:
            self.bad = f"not settled within {self.rules.settle_limit:g} s: {self.missing}"

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
        if self.height is not None and abs(height - self.height) > _ARRIVED:
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


#: Periods in one reading of the amplitude: a motion of twice the period is regular.
_PERIODS = 2
#: Scatter of the readings from which a motion is called irregular [-].
IRREGULAR = 0.02
#: Of a simulated point: time before it counts, time that counts [s], and of that at least so many measurements; samples
#: a period.
_TRANSIENT, _USED, _FEWEST, _SAMPLES = 20.0, 40.0, 4, 400.0
#: The fourth difference of white noise over its standard deviation, and of that over the median of its size.
_FOURTH, _MEDIAN = math.sqrt(70.0), 1.4826


@dataclass(frozen=True)
class Amplitude:
    """Half the beam's peak-to-peak, mean over readings of two periods."""

    value: float  # [m]
    std: float  # of that mean [m]
    scatter: float  # of single readings, relative [-]


def _amplitude_of(beam: Array, rate: float, frequency: float) -> Amplitude:
    """Return the amplitude of samples (n,) [m] at `rate` [Hz], of a motion driven at `frequency` [Hz].

    The error bar counts the scatter of readings, and the noise, by which peaks read too large.
    """
    readings = amplitudes_per_period(beam, _PERIODS * rate / frequency)
    value, scatter = float(readings.mean()), float(readings.std(ddof=1))
    noise = _MEDIAN * float(np.median(np.abs(np.diff(beam, 4)))) / _FOURTH
    return Amplitude(value, math.hypot(scatter / math.sqrt(readings.size), noise), scatter / value if value else 0.0)


def measured(folder: Path, point: Point, judge: Judge) -> Document:
    """Return what was measured in a point whose bag is in `folder`. What is wrong with it becomes `judge.bad`."""
    run = open_run(folder / "bag")
    shift = 1e-9 * run.start_ns
    beam = run.signals(run.drive.channel, "beam_displacement")[1]
    begin, end = judge.begin - shift, judge.end - shift
    inside = beam.values[(beam.time > begin) & (beam.time <= end + 0.5 / beam.rate)]
    expected = round((end - begin) * beam.rate)
    if (lost := expected - int(np.isfinite(inside).sum())) > 0:
        judge.bad = f"{lost} of {expected} samples lost or saturated in the bag"
        return {}
    found = _amplitude_of(inside, beam.rate, point.frequency)
    identified: dict[str, float] = {}
    for name in ("amplitude", "frequency"):
        values, stds = (np.array([getattr(one, key) for one in judge.estimates]) for key in (name, f"{name}_std"))
        identified[f"excitation_{name}"] = float(values.mean())
        identified[f"excitation_{name}_std"] = math.hypot(stds.mean(), values.std())
    height, missing = float(np.median(judge.heights)), run.missing
    amplitude = {"beam_amplitude": found.value, "beam_amplitude_std": found.std, "scatter": found.scatter}
    part = {"begin": begin, "end": end, "samples": int(inside.size), "settled_after": judge.settled_after}
    regular = found.scatter < IRREGULAR
    return {**identified, "height": height, **amplitude, "regular": regular, **part, "missing": missing}


def simulated(campaign: Campaign, scene: Scene, record: Document) -> dict[str, float]:
    """Return amplitudes [m] of the beam by simulation at the excitation and height that were measured, with error bars.

    The bar has what the motion's irregularity leaves to chance within a measurement, and what the errors of
    excitation and height come to; that of the closed damper beside it has none.
    """
    own = scene.with_(mass_fraction=record["wanted_mass_fraction"])
    names = ("excitation_amplitude", "excitation_frequency", "height")
    given, lowest = [record[name] for name in names], 2.0 * own.grain.radius
    found, chance = steady_amplitude(own, given, campaign.rules.measure_periods)
    parts = [chance]
    errors = *(record[f"{name}_std"] for name in names[:2]), campaign.height_std
    for place, error in enumerate(errors):
        beside = list(given)
        beside[place] += error
        if error > 0.0 and not (place == 2 and given[2] <= lowest + 2.0 * error):  # a closed ceiling holds the grain
            parts.append(abs(steady_amplitude(own, beside, campaign.rules.measure_periods)[0] - found))
    return {
        "simulated_amplitude": found,
        "simulated_amplitude_std": math.hypot(*parts),
        "closed_amplitude": own.linear_amplitude(*given[:2], grain=True),
        "bare_amplitude": own.linear_amplitude(*given[:2], grain=False),
    }


def steady_amplitude(scene: Scene, given: Sequence[float], periods: int) -> tuple[float, float]:
    """Return the beam's steady amplitude [m], and its standard deviation over measurements of so many periods.

    given: amplitude [m or N] and frequency [Hz] of the excitation, and the height [m] to which the ceiling opens. The
    deviation of a motion that repeats itself is 0; both are NaN where it cannot be followed.
    """
    amplitude, frequency, height = given
    closed, lowest = float(scene.ceiling.heights[0][1]), 2.0 * scene.grain.radius
    if height <= max(closed, lowest) + 1e-4:
        return scene.linear_amplitude(amplitude, frequency, grain=True), 0.0
    used = max(_USED, _FEWEST * periods / frequency)
    begin = _TRANSIENT + (height - closed) / scene.ceiling.speed
    window = {"duration": begin + used, "steady_window": [begin, begin + used]}
    own = from_rest(scene, amplitude, frequency, height, **window)
    try:
        search = steady_state(own)
        if search.state is not None and search.state.periods <= _PERIODS:
            return search.state.amplitude, search.state.amplitude * search.state.error_estimate
        rate = _SAMPLES * frequency
        beam = trajectory(own, rate).beam[round(begin * rate) :]
    except NumericalFailure:
        return math.nan, math.nan
    length = round(periods * _SAMPLES)
    begins = range(0, beam.size - length + 1, length)
    parts = [_amplitude_of(beam[at : at + length], rate, frequency).value for at in begins]
    return float(np.mean(parts)), float(np.std(parts, ddof=1))
