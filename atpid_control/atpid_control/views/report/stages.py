# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stages of a run, intervals of constant excitation: what was measured at the ends, and what the thesis prints.

The run is simulated again: with the damper closed, as the baseline, and as recorded: is it reproducible?
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import Document
from atpid_control.runs.run import Run
from atpid_control.runs.tables import TRUTH
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene
from atpid_sim.simulation.excitation import amplitude_at, frequency_at, frequency_points
from atpid_sim.simulation.integration import is_closed
from atpid_sim.simulation.quantities import efficiency, half_peak_to_peak
from atpid_sim.simulation.reproducibility import Verdict
from atpid_sim.simulation.simulate import trajectory, verdicts
from atpid_sim.system import Array

#: Begin and end [s].
Interval = tuple[float, float]


def closed_height(scene: Scene) -> float:
    """Return the height of the closed damper [m]: the scene's own, else the grain's diameter."""
    return float(getattr(scene.ceiling, "closed", 2.0 * scene.grain.radius))


def closed_by_simulation(scene: Scene, times: Array) -> Array:
    """Simulate the scene with the ceiling held closed; return the beam's displacement (n,) [m] at `times` (n,) [s].

    Beam and grain as one mass where the ceiling touches the grain, as `simulate` takes it for `undamped_amplitude`.
    Raises NumericalFailure as `atpid_sim.simulation.simulate` does.
    """
    rate = max(scene.sensors.laser.rate, 100.0 * scene.frequency_hz)
    duration = max(scene.duration, float(times[-1]) + 1.0 / rate)
    held = scene.with_(height=closed_height(scene), duration=duration, steady_window=[0.0, duration])
    found = trajectory(held, rate, "simplified" if is_closed(held) else "auto")
    return np.asarray(np.interp(times, found.time, found.beam))


def closed_motion(run: Run) -> Array | None:
    """Return the closed damper's beam (n,) [m] at the run's times; None without a scene or a simulation."""
    if run.scene is None:
        return None
    try:
        return closed_by_simulation(run.scene, run.motion.time)
    except NumericalFailure:
        return None


#: A change of the ceiling's velocity below this is rounding [m a sample].
_KINK = 1e-9


def repeated(run: Run, windows: Sequence[Interval]) -> list[Verdict | None]:
    """Return the verdict on each window (begin, end) [s] of a recorded run, which is simulated and repeated.

    None for each of a run that was not simulated, of one without a scene, and where the simulation fails.
    """
    nothing: list[Verdict | None] = [None] * len(windows)
    if run.truth is None or run.scene is None or not windows:
        return nothing
    changes: Document = {"duration": windows[-1][1], "steady_window": list(windows[-1])}
    if run.scene.ceiling.controlled:
        # the plant begins with its scene, whose samples a device may have taken some milliseconds later
        elapsed = run.truth.time - run.truth.time[0]
        times, heights = corners(elapsed, np.maximum(run.truth.ceiling, 2.0 * run.scene.grain.radius))
        changes["ceiling"] = {"profile": [[float(t), float(h)] for t, h in zip(times, heights, strict=True)]}
    try:
        return verdicts(run.scene.with_(**changes), windows)
    except NumericalFailure:
        return nothing


def corners(time: Array, height: Array) -> tuple[Array, Array]:
    """Return the points (k,) [s, m] between which a sampled height (n,) of piecewise constant velocity is straight."""
    bends = np.abs(np.diff(height, 2)) > _KINK
    kept = np.flatnonzero(np.concatenate(([True], bends, [True])))
    return time[kept], height[kept]


#: A ceiling this close to the height commanded has arrived [m]: ten times what the motor resolves.
_ARRIVED = 5e-3
#: Length of the window at the end of a stage in which everything is measured [s].
WINDOW = 2.0


@dataclass(frozen=True)
class Stage:
    """One stage: the keys of the bench's summary. NaN: unknown."""

    t0: float  # [s]
    t1: float  # [s]
    excitation_amplitude: float  # true [m], of a force [N]
    identified_amplitude: float  # mean of the steady estimates in the window, likewise
    identified_frequency: float  # likewise [Hz]
    height: float  # of the ceiling, median in the window [m]
    amplitude: float  # half peak-to-peak of the beam in the window [m]
    undamped_amplitude: float  # the same with the damper closed [m]
    efficiency: float  # 1 - amplitude / undamped_amplitude [-]
    bare_amplitude: float = math.nan  # of the structure as it is without the damper, at the same excitation [m]
    reduction: float = math.nan  # 1 - amplitude / bare_amplitude [-]; below 0: the damper makes it worse
    commanded_height: float = math.nan  # the last one before the window's end [m]
    reproducible: bool | None = None  # whether repeated simulations agree; None: unknown
    amplitude_spread: tuple[float, float] | None = None  # least and largest of them, where they do not agree [m]

    @property
    def efficiency_range(self) -> tuple[float, float]:
        """Least and largest efficiency of repeated runs [-]; twice the efficiency where they agree."""
        return self._range(self.efficiency, self.undamped_amplitude)

    @property
    def reduction_range(self) -> tuple[float, float]:
        """Least and largest reduction of repeated runs [-]; twice the reduction where they agree."""
        return self._range(self.reduction, self.bare_amplitude)

    def _range(self, share: float, reference: float) -> tuple[float, float]:
        if self.amplitude_spread is None:
            return share, share
        least, largest = self.amplitude_spread
        return efficiency(largest, reference), efficiency(least, reference)

    @property
    def arrived(self) -> bool:
        """Whether the ceiling was where it had been commanded to; true where that is unknown."""
        return not abs(self.height - self.commanded_height) > _ARRIVED


def per_cent(limits: tuple[float, float]) -> str:
    """Return a share, or the range between two [-], in per cent; a dash where it is unknown."""
    if not math.isfinite(limits[0]):
        return "–"
    least, largest = (f"{round(100.0 * value)}".replace("-", "−") for value in limits)
    return f"{least} %" if least == largest else f"{least} to {largest} %"


def measure(run: Run, closed: Array | None) -> tuple[list[Stage], list[Interval]]:
    """Return the stages and where each is measured, given the closed damper's beam (n,) [m] at the run's times."""
    found = intervals(run)
    windows = [_window_of(run, *interval) for interval in found]
    again, (given, _) = repeated(run, windows), true_excitation(run)
    measured = [_measure(run, closed, *parts, given) for parts in zip(found, windows, again, strict=True)]
    return measured, windows


def true_excitation(run: Run) -> tuple[Array | None, Array | None]:
    """Return true amplitude (n,) [m or N] and frequency (n,) [Hz], of a tone, at the motion's times; None: unknown."""
    if (scene := run.scene) is None:
        return None, None
    amplitude = _true(run, scene, scene.excitation.amplitude_points)
    return amplitude, _true(run, scene, frequency_points(scene)) if scene.excitation.is_tone else None


def _true(run: Run, scene: Scene, points: Sequence[tuple[float, float]]) -> Array | None:
    times, values = np.array(points).T
    if scene.excitation.is_free or not np.isfinite(values).all():
        return None
    return np.asarray(np.interp(run.motion.time, times, values))


def intervals(run: Run) -> list[Interval]:
    """Return (begin, end) [s] of the intervals of constant amplitude above zero that the run reached the end of."""
    if run.scene is None or not run.scene.excitation.is_tone:
        return []
    return constant_intervals(run.scene, min(run.scene.duration, run.duration))


def constant_intervals(scene: Scene, end: float) -> list[Interval]:
    """Return (begin, end) [s] of the intervals of constant frequency and amplitude above zero of a tone, to `end`."""
    kinks = {t for t, _ in (*scene.excitation.amplitude_points, *frequency_points(scene)) if 0.0 < t < end}
    found: list[Interval] = []
    joined = False  # whether the interval before was constant, so that this one continues it
    for t0, t1 in pairwise(sorted({0.0, end, *kinks})):
        amplitudes, frequencies = ({of(scene, t0), of(scene, t1)} for of in (amplitude_at, frequency_at))
        constant = len(amplitudes) == len(frequencies) == 1 and min(amplitudes) > 0.0
        if constant:
            found = [*found[:-1], (found[-1][0], t1)] if joined else [*found, (t0, t1)]
        joined = constant
    return found


def _window_of(run: Run, t0: float, t1: float) -> Interval:
    """Return the window [s] a stage is measured in: its last 2 s; the scene's own where there is one stage only."""
    scene = run.scene
    if scene is not None and len(intervals(run)) == 1 and "steady_window" in scene.model_fields_set:
        first, last = scene.steady_window
        if t0 <= first < last <= t1 + 1e-9:
            return first, last
    return max(t0, t1 - min(WINDOW, 0.5 * (t1 - t0))), t1


def _measure(
    run: Run, closed: Array | None, interval: Interval, window: Interval, again: Verdict | None, given: Array | None
) -> Stage:
    (t0, t1), (begin, end) = interval, window
    inside = _within(run.motion.time, begin, end)
    amplitude = half_peak_to_peak(run.motion.beam[inside])
    undamped = half_peak_to_peak(closed[inside]) if closed is not None else math.nan
    estimated = _within(run.estimates.time, begin, end) & run.estimates.steady
    spread = again.spread if again else None
    repetitions = [value for value in (*(spread or ()), amplitude) if math.isfinite(value)]
    bare = math.nan
    if (scene := run.scene) is not None:
        bare = scene.linear_amplitude(amplitude_at(scene, t0), frequency_at(scene, t0), grain=False)
    return Stage(
        t0=t0,
        t1=t1,
        excitation_amplitude=float(given[inside][-1]) if given is not None and inside.any() else math.nan,
        identified_amplitude=_mean(run.estimates.amplitude[estimated]),
        identified_frequency=_mean(run.estimates.frequency[estimated]),
        height=_height(run, begin, end),
        amplitude=amplitude,
        undamped_amplitude=undamped,
        efficiency=efficiency(amplitude, undamped),
        bare_amplitude=bare,
        reduction=efficiency(amplitude, bare),
        commanded_height=_commanded(run, end),
        reproducible=again.reproducible if again else None,
        amplitude_spread=(min(repetitions), max(repetitions)) if spread else None,
    )


def _commanded(run: Run, end: float) -> float:
    """Return the height [m] commanded last before `end` [s]; NaN where none was."""
    sent = run.commands
    heights = sent.height[np.isfinite(sent.height) & (sent.time <= end + 1e-9)]
    return float(heights[-1]) if len(heights) else math.nan


def _height(run: Run, begin: float, end: float) -> float:
    if run.motion.origin == TRUTH:
        seen = run.motion.ceiling[_within(run.motion.time, begin, end)]
    else:
        seen = run.ceiling.height[_within(run.ceiling.time, begin, end)]
    return float(np.nanmedian(seen)) if np.isfinite(seen).any() else math.nan


def _within(times: Array, begin: float, end: float) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (times >= begin - 1e-9) & (times <= end + 1e-9)
    return inside


def _mean(values: Array) -> float:
    seen = values[np.isfinite(values)]
    return float(seen.mean()) if len(seen) else math.nan


@dataclass(frozen=True)
class Printed:
    """One stage as printed."""

    excitation: float  # [m]; the first is printed as 0.15, a slip (DESIGN: the 0.3 m of Fig. 4.5 belong to 0.015)
    height: float  # [m]
    amplitude: float  # of the beam, adaptive [m]
    closed: float  # of the beam, closed damper [m]
    best_height: float  # what a search over all heights finds with this model [m]
    best_efficiency: float  # there [-]
    height_sign: str = ""  # "above", where the thesis prints it

    @property
    def efficiency(self) -> float:
        """1 - amplitude / closed [-]."""
        return efficiency(self.amplitude, self.closed)


_SECTION_4_3 = (
    Printed(0.015, 0.30, 0.07, 0.30, 0.29, 0.80),
    Printed(0.040, 0.70, 0.17, 0.85, 0.76, 0.81, "> "),
    Printed(0.030, 0.57, 0.13, 0.65, 0.57, 0.81),
)
_MASS_FRACTION, _STIFFNESS = 0.1, 427.6


def beside(run: Run, stages: list[Stage]) -> list[Printed] | None:
    """Return the thesis's stages where `run` is its adaptive bench, else None."""
    scene = run.scene
    if scene is None or not scene.ceiling.controlled or len(stages) != len(_SECTION_4_3):
        return None
    same_system = np.isclose([scene.grain.mass_fraction, scene.beam.stiffness], [_MASS_FRACTION, _STIFFNESS]).all()
    given = [stage.excitation_amplitude for stage in stages]
    same_stages = np.allclose(given, [printed.excitation for printed in _SECTION_4_3], rtol=1e-6)
    return list(_SECTION_4_3) if same_system and same_stages else None


#: Largest ratio of successive peaks measured on the stand (section 2.3.1), by mass fraction and height [m].
_OVER_HEIGHTS, _OVER_MASSES = {0.05: 1.345, 0.10: 1.38, 0.15: 1.40, 0.20: 1.42}, {0.05: 1.52, 0.1: 1.8, 0.2: 2.5}
_MEASURED_DECREMENTS = {(0.025, height): ratio for height, ratio in _OVER_HEIGHTS.items()}
_MEASURED_DECREMENTS |= {(mass_fraction, 0.20): ratio for mass_fraction, ratio in _OVER_MASSES.items()}
_MEASURED_CLOSED = 1.31
_MEASURED_STIFFNESS, _MEASURED_DEFLECTION = 117.6, 0.2


def measured_decrement(scene: Scene, height: float) -> float | None:
    """Return what the stand showed for a free decay like the scene's with the ceiling at `height` [m], 0 for closed.

    None where that was not measured.
    """
    if not scene.excitation.is_free:
        return None
    given = (scene.beam.stiffness, scene.excitation.deflection)
    if not np.allclose(given, (_MEASURED_STIFFNESS, _MEASURED_DEFLECTION)):
        return None
    if height <= 2.0 * scene.grain.radius:
        return _MEASURED_CLOSED
    here = (scene.grain.mass_fraction, height)
    return next((value for measured, value in _MEASURED_DECREMENTS.items() if np.allclose(measured, here)), None)
