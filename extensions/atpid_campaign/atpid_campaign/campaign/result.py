# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a point was measured to be, from its bag, and what simulation of the same point gives; both with error bars."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from atpid_campaign.campaign.judge import Judge
from atpid_campaign.campaign.plan import Campaign, Point, from_rest
from atpid_control.runs.run import open_run
from atpid_sim.outcome import NumericalFailure
from atpid_sim.periodic import steady_state
from atpid_sim.scene import Scene
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

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


def amplitude_of(beam: Array, rate: float, frequency: float) -> Amplitude:
    """Return the amplitude of samples (n,) [m] at `rate` [Hz], of a motion driven at `frequency` [Hz].

    The error bar counts the scatter of readings, and the noise, by which peaks read too large.
    """
    length = _PERIODS * rate / frequency
    edges = np.round(length * np.arange(int(beam.size / length) + 1)).astype(int)
    readings = np.array([half_peak_to_peak(beam[a:b]) for a, b in pairwise(edges)])
    value, scatter = float(readings.mean()), float(readings.std(ddof=1))
    noise = _MEDIAN * float(np.median(np.abs(np.diff(beam, 4)))) / _FOURTH
    return Amplitude(value, math.hypot(scatter / math.sqrt(readings.size), noise), scatter / value if value else 0.0)


def measured(folder: Path, point: Point, judge: Judge) -> dict[str, Any]:
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
    found = amplitude_of(inside, beam.rate, point.frequency)
    identified: dict[str, float] = {}
    for name in ("amplitude", "frequency"):
        values, stds = (np.array([getattr(one, key) for one in judge.estimates]) for key in (name, f"{name}_std"))
        identified[f"excitation_{name}"] = float(values.mean())
        identified[f"excitation_{name}_std"] = math.hypot(stds.mean(), values.std())
    return {
        **identified, "height": float(np.median(judge.heights)), "beam_amplitude": found.value,
        "beam_amplitude_std": found.std, "scatter": found.scatter, "regular": found.scatter < IRREGULAR,
        "begin": begin, "end": end, "samples": int(inside.size), "settled_after": judge.settled_after,
        "missing": run.missing,
    }  # fmt: skip


def simulated(campaign: Campaign, scene: Scene, record: Mapping[str, Any]) -> dict[str, float]:
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
        "simulated_amplitude": found, "simulated_amplitude_std": math.hypot(*parts),
        "closed_amplitude": own.linear_amplitude(*given[:2], grain=True),
        "bare_amplitude": own.linear_amplitude(*given[:2], grain=False),
    }  # fmt: skip


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
    parts = [amplitude_of(beam[at : at + length], rate, frequency).value
             for at in range(0, beam.size - length + 1, length)]  # fmt: skip
    return float(np.mean(parts)), float(np.std(parts, ddof=1))
