# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag validate RECORDING`: a scene simulated with the measured support, compared by period (Eq. 3.46).

Rules. Support and beam count from their rest: the mean over the whole periods of the second half of the part. The beam
begins with displacement and velocity of a polynomial of fifth degree through the first quarter of a period; the grain
lies on the floor. Where the ceiling is open at the begin, the place of the grain is unknown, so the first 20 periods
are left out. A lag between the two channels, of at most half a period, and the means are taken off before the
comparison. Periods in which the measured amplitude is below 5 % of its largest are left out of relative errors.

The thesis divides by the measured X_Exp. Its list of symbols calls that an amplitude, and a displacement passes zero in
every period: so amplitudes of whole periods are compared, half the range in each, in which no offset is left and a lag
of less than a period changes little.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from atpid_common import output
from atpid_common.arguments import file_path, positive
from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_common.vocabulary import DRIVES, Drive
from atpid_control.analysis.signals import runs, signals_of
from atpid_control.commands.results import Shown, add_part, add_results, claim, give, two_columns
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import BEAM, Run, open_run
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, Panels
from atpid_sim.scene import Scene, SceneError, load_scene
from atpid_sim.simulation.integration import FIDELITIES
from atpid_sim.simulation.quantities import amplitudes_per_period
from atpid_sim.simulation.simulate import simulate, trajectory
from atpid_sim.system import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Samples below which nothing is compared: a cubic spline and an initial velocity need more.
_FEWEST_SAMPLES = 100


class ValidationError(InputError):
    """A recording that cannot be simulated: what is missing in it, and what to give."""


@dataclass(frozen=True)
class Measured:
    """Samples (n,) at `rate` [Hz]; height of the ceiling (k, 2) [s, m], None where it was not recorded."""

    rate: float
    support: Array  # displacement [m], of a force that drives instead [N]
    beam: Array  # displacement [m]
    ceiling: Array | None
    begin: float = 0.0  # of the part, in the recording [s]
    chosen: bool = False  # as the longest part without a gap
    origin: str = ""  # of the samples, such as `laser`
    drive: Drive = DRIVES["support"]
    missing: tuple[str, ...] = ()  # what is not in the recording and should be, a line each

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return (len(self.beam) - 1) / self.rate


def read_measured(run: Run, begin: float = -math.inf, end: float = math.inf) -> Measured:
    """Return the part from `begin` to `end` [s] of a recording; of a whole one with gaps the longest without.

    Raises ValidationError where there is none, or where a part that was chosen has gaps.
    """
    whole, missing = signals_of(run, both=False)
    if not np.isfinite(whole.excitation).any():
        raise ValidationError(f"{run.path}: {run.drive.channel} was not recorded, so nothing can drive the scene")
    entire = math.isinf(begin) and math.isinf(end)
    if entire:
        valid = runs(np.isfinite(whole.excitation + whole.response))
        first, last = max(valid, key=lambda each: each[1] - each[0], default=(0, len(whole.response)))
        begin, end = whole.start + first / whole.rate, whole.start + (last - 1) / whole.rate
    part = whole.between(begin, end)
    if len(part.response) < _FEWEST_SAMPLES:
        raise ValidationError(f"{run.path}: {len(part.response)} samples in that part; needed: {_FEWEST_SAMPLES}")
    for name, series in ((run.drive.channel, part.excitation), (BEAM, part.response)):
        gaps = np.flatnonzero(~np.isfinite(series))
        if len(gaps):
            at = part.start + gaps[0] / part.rate
            wrong = f"{run.path}: {name} is missing or invalid at {at:g} s"
            raise ValidationError(f"{wrong}; choose a part with --from, --to")
    heights = np.column_stack([run.ceiling.time - part.start, run.ceiling.height])
    heights = heights[np.isfinite(heights).all(axis=1)]
    heights = heights[np.argsort(heights[:, 0], kind="stable")]
    chosen = entire and len(part.response) < len(whole.response)
    ceiling, about = heights if len(heights) else None, (part.origin, run.drive, tuple(missing))
    return Measured(part.rate, part.excitation, part.response, ceiling, part.start, chosen, *about)


def scene_of(run: Run) -> Scene:
    """Return the scene kept in the run; raise SceneError or ValidationError where there is none."""
    if run.scene is not None:
        return run.scene
    if run.scene_text is None:
        raise ValidationError(f"{run.path}: no scene was recorded; give one with --scene")
    raise SceneError(f"{run.scene_problem}; give a scene with --scene")


#: Part of a period whose polynomial gives the initial state, and its degree: both errors, of the sixth power and of a
#: sensor's noise, are then some 1e-4 of the amplitude.
_BEGIN, _DEGREE = 0.25, 5
#: Periods left out where the grain's place at the begin is unknown.
_UNKNOWN = 20
#: Periods that have to remain.
_FEWEST = 5
#: Share of the largest amplitude below which a period has no relative error.
_STILL = 0.05
#: A ceiling within this of the grain holds it [m].
_CLOSED = 5e-4
#: Change of a height below which a motor is at rest [m].
_STANDS = 1e-5


@dataclass(frozen=True)
class Agreement:
    """Measured and simulated motion of the beam, aligned, and how they differ."""

    time: Array  # (n,) since the begin of the part [s]
    measured: Array  # (n,) from rest [m]
    simulated: Array  # (n,) from rest [m]
    ceiling: Array  # (n,) height [m]
    period_time: Array  # (k,) middle of each whole period [s]
    measured_amplitude: Array  # (k,) [m]
    simulated_amplitude: Array  # (k,) [m]
    compared: NDArray[np.bool_]  # (k,) whether the period counts
    lag: float  # of the measurement [s]
    left_out: float  # at the begin [s]
    fidelity: str
    reproducible: bool  # whether repeated simulations agree; else the motion is irregular

    @property
    def errors(self) -> Array:
        """(X_Exp - X_Sim) / X_Exp of the periods that count (j,) [-]."""
        one, other = self.measured_amplitude[self.compared], self.simulated_amplitude[self.compared]
        return np.asarray((one - other) / one)

    @property
    def rmse(self) -> float:
        """Root mean square of `errors` [-] (Eq. 3.46)."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def displacement_error(self) -> float:
        """Root mean square of the difference of the displacements over that of the measured one [-]."""
        return float(np.sqrt(np.mean((self.measured - self.simulated) ** 2) / np.mean(self.measured**2)))

    def to_json(self) -> Document:
        """Return the numbers, in SI units."""
        worst = int(np.argmax(np.abs(self.errors)))
        kept = {name: getattr(self, name) for name in ("lag", "left_out", "fidelity", "reproducible")}
        return kept | {
            "relative_rmse": self.rmse,
            "displacement_error": self.displacement_error,
            "largest_error": float(self.errors[worst]),
            "largest_error_at": float(self.period_time[self.compared][worst]),
            "periods": len(self.compared),
            "compared_periods": int(self.compared.sum()),
        }


def driven_scene(scene: Scene, measured: Measured, series: Path, height: float | None) -> Scene:
    """Return the scene driven by the series in the file `series`, begun as measured, under the recorded ceiling.

    `height` [m] replaces the ceiling by a fixed one. Raises ValidationError where the recording has no
    ceiling and none is given, SceneError where the scene does not fit.
    """
    period = 1.0 / scene.natural_frequency_hz
    if measured.drive is not scene.driven_by:
        given = f"drive: given {scene.drive}; the recording has {measured.drive.channel}"
        raise ValidationError(f"{given}; give a scene with that drive")
    if measured.duration < 2.0 * period:
        raise ValidationError(f"the part lasts {measured.duration:g} s; needed: two periods, {2.0 * period:.3g} s")
    count = max(2 * _DEGREE, math.ceil(_BEGIN * period * measured.rate))
    times = np.arange(count) / measured.rate
    start = np.polynomial.Polynomial.fit(times, measured.beam[:count], _DEGREE)
    samples = period * measured.rate
    ceiling: Document = {"height": height}
    if height is None:
        if measured.ceiling is None:
            raise ValidationError("the ceiling's height was not recorded; give --height")
        ceiling = {"profile": _profile(measured.ceiling, measured.duration, 2.0 * scene.grain.radius)}
    closed = (height or ceiling["profile"][0][1]) <= 2.0 * scene.grain.radius + _CLOSED
    left_out = 0.0 if closed else _UNKNOWN * period
    if left_out + _FEWEST * period > measured.duration:
        raise ValidationError(
            f"the part lasts {measured.duration:g} s, of which {left_out:.3g} s are left out (the ceiling is open at "
            f"its begin); needed: {_FEWEST} periods more, {left_out + _FEWEST * period:.3g} s, or a closed damper there"
        )
    changes: Document = {"ceiling": ceiling, "steady_window": [left_out, measured.duration]}
    driven: Document = {"file": str(series), "displacement": measured.drive.channel}
    driven["offset"] = _rest_of(measured.support, samples)
    from_rest = float(start(0.0)) - _rest_of(measured.beam, samples)
    changes["initial"] = {"displacement": from_rest, "velocity": float(start.deriv()(0.0))}
    return scene.with_(excitation={"series": driven}, duration=measured.duration, **changes)


def _rest_of(displacement: Array, samples: float) -> float:
    """Return the mean [m] of a displacement (n,) [m] over the whole periods, `samples` each, of its second half."""
    count = round(max(1.0, np.floor(0.5 * len(displacement) / samples)) * samples)
    return float(displacement[-count:].mean())


def compare(scene: Scene, measured: Measured, fidelity: str = "auto") -> Agreement:
    """Simulate a scene of `driven_scene` and compare; raises NumericalFailure as `simulate` does."""
    result = simulate(scene, fidelity)
    motion = trajectory(scene, measured.rate, fidelity)
    first = math.ceil(scene.steady_window[0] * measured.rate)
    size = min(len(motion.beam), len(measured.beam))
    samples = measured.rate / scene.natural_frequency_hz
    experiment, simulation = measured.beam[first:size], motion.beam[first:size]
    lag = lag_of(experiment, simulation, int(0.5 * samples))
    one, other = aligned(experiment, simulation, lag)
    begin = first + max(-lag, 0)  # of the simulation
    ours, theirs = (amplitudes_per_period(series, samples) for series in (one, other))
    compared = ours > _STILL * ours.max()
    time, ceiling = motion.time[begin : begin + len(one)], motion.ceiling[begin : begin + len(one)]
    periods = time[0] + (np.arange(len(ours)) + 0.5) / scene.natural_frequency_hz
    series = time, one - one.mean(), other - other.mean(), ceiling, periods, ours, theirs, compared
    found = lag / measured.rate, scene.steady_window[0], result.fidelity, result.reproducible
    return Agreement(*series, *found)


def _profile(heights: Array, duration: float, least: float) -> list[list[float]]:
    """Return the points [s, m] between which recorded heights (k, 2) are straight, from 0 to `duration` [s]."""
    knots = np.unique(np.concatenate([[0.0], heights[(heights[:, 0] > 0.0) & (heights[:, 0] < duration), 0]]))
    values = np.maximum(np.interp(knots, heights[:, 0], heights[:, 1]), least)
    changes = np.abs(np.diff(values)) > _STANDS
    kept = np.concatenate([[True], changes]) | np.concatenate([changes, [True]])
    return [[float(t), float(h)] for t, h in zip(knots[kept], values[kept], strict=True)]


def lag_of(measured: Array, simulated: Array, most: int) -> int:
    """Return by how many samples a measurement (n,) is later than its simulation (n,): the best correlation.

    Looked for from -most to most samples; both are taken without their means.
    """
    one, other = measured - measured.mean(), simulated - simulated.mean()
    size = len(one)

    def correlation(lag: int) -> float:
        return float(one[max(lag, 0) : size + min(lag, 0)] @ other[max(-lag, 0) : size - max(lag, 0)])

    return max(range(-most, most + 1), key=correlation)


def aligned(measured: Array, simulated: Array, lag: int) -> tuple[Array, Array]:
    """Return both series (k,) [m] over their common time, the lag [samples] and the offset removed."""
    size = len(measured)
    one, other = measured[max(lag, 0) : size + min(lag, 0)], simulated[max(-lag, 0) : size - max(lag, 0)]
    return one - one.mean() + other.mean(), other


SERIES, SCENE, PICTURE, NUMBERS = "support.csv", "scene.yaml", "agreement.png", "agreement.json"
EXAMPLE = "bags/thesis_4_3_short --out out/agreement"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    recording = "a bag, of one that is cut off what is there, or a .csv table with time, support and beam"
    add("recording", type=file_path, metavar="RECORDING", help=recording)
    scene = "beam, grain and contact; default: the scene kept in the bag"
    add("--scene", type=file_path, metavar="SCENE.yaml", help=scene)
    add("--height", type=positive("m"), metavar="H", help="a fixed ceiling [m]; default: as recorded")
    add_part(parser, "begin of the part compared")
    add("--fidelity", default="auto", choices=["auto", *FIDELITIES], help="fidelity level; default: auto")
    add_results(parser, "scene, series, picture and numbers")


def run(args: argparse.Namespace) -> int:
    """Simulate, compare, print; return 0.

    Raises ValidationError, SceneError, BagError, NumericalFailure, OutputError.
    """
    args.recording = bag_of(args.recording)
    series, kept, picture, file = claim(args, SERIES, SCENE, PICTURE, NUMBERS)
    recorded = open_run(args.recording)
    measured = read_measured(recorded, args.begin, args.end)
    scene = scene_of(recorded) if args.scene is None else load_scene(args.scene)
    times = np.arange(len(measured.support)) / measured.rate
    with output.writing(series):
        columns, head = np.column_stack([times, measured.support]), f"time,{measured.drive.channel}"
        np.savetxt(series, columns, fmt="%.12g", delimiter=",", header=head, comments="")
    driven = driven_scene(scene, measured, series.resolve(), args.height)
    with output.writing(kept):
        kept.write_text(driven.to_yaml(), encoding="utf-8")
    with working("simulating"):
        found = compare(driven, measured, args.fidelity)
    end = measured.begin + measured.duration
    faults = recorded.faults(measured.begin, end)
    part = {"begin": measured.begin, "end": end, "without_gap": measured.chosen, "missing": measured.missing}
    numbers = found.to_json() | part | {"origin": measured.origin, "faults": faults}
    notes = [f"not to be trusted: {line}" for line in faults]
    title = f"{args.recording} beside its simulation"
    return give(args, numbers, file, Shown(title, _table(found, measured), notes, picture, panels(found)))


def _table(found: Agreement, measured: Measured) -> Table:
    numbers = found.to_json()
    irregular = "" if found.reproducible else " (irregular: repeated simulations do not agree)"
    span = f"{measured.begin:.4g} to {measured.begin + measured.duration:.4g} s"
    rows = [
        ("origin of the samples", measured.origin),
        ("part", f"{span}, the longest without a gap" if measured.chosen else span),
        ("relative RMSE of the amplitudes (Eq. 3.46)", f"{100.0 * found.rmse:.3g} %"),
        ("largest of a period", f"{100.0 * numbers['largest_error']:+.3g} % at {numbers['largest_error_at']:.3g} s"),
        ("difference of the displacements, root mean square", f"{100.0 * found.displacement_error:.3g} %"),
        ("periods compared", f"{numbers['compared_periods']} of {numbers['periods']}"),
        ("left out at the begin, grain's place unknown", f"{found.left_out:.3g} s"),
        ("lag of the measured beam, taken off", f"{1e3 * found.lag:.3g} ms"),
        ("fidelity", found.fidelity + irregular),
    ]
    return two_columns(rows)


#: Periods shown close up, at the end.
_CLOSE_UP = 6


def panels(found: Agreement) -> Panels:
    """Return the panels of a comparison."""
    period = float(np.diff(found.period_time)[0]) if len(found.period_time) > 1 else np.inf
    begin = max(found.time[0], found.time[-1] - _CLOSE_UP * period)
    whole = partial(_motions, found=found, begin=found.time[0], title="Beam displacement from rest")
    last = partial(_motions, found=found, begin=begin, title=f"The last {_CLOSE_UP} periods")
    between = (partial(drawer, found=found) for drawer in (_difference, _amplitudes, _ceiling))
    return [[drawer] for drawer in (whole, *between, last)]


def _difference(ax: Axes, found: Agreement) -> None:
    ax.plot(found.time, 1e3 * (found.measured - found.simulated), LIGHT.accent, linewidth=0.7)
    _over_time(ax, found, "Measured less simulated")


def _amplitudes(ax: Axes, found: Agreement) -> None:
    ax.plot(found.period_time, 1e3 * found.measured_amplitude, LIGHT.given_text, marker=".", label="measured")
    ax.plot(found.period_time, 1e3 * found.simulated_amplitude, LIGHT.own, linewidth=1.2, label="simulated")
    _over_time(ax, found, f"Amplitude of each period; relative RMSE {100.0 * found.rmse:.2g} %")
    ax.set_ylim(0.0, None)


def _ceiling(ax: Axes, found: Agreement) -> None:
    ax.plot(found.time, 1e3 * found.ceiling, LIGHT.own, linewidth=1.4)
    _over_time(ax, found, "Ceiling height")
    ax.set_ylim(0.0, None)


def _motions(ax: Axes, found: Agreement, begin: float, title: str) -> None:
    shown = found.time >= begin
    ax.plot(found.time[shown], 1e3 * found.measured[shown], LIGHT.given_text, linewidth=2.4, label="measured")
    ax.plot(found.time[shown], 1e3 * found.simulated[shown], LIGHT.own, linewidth=0.8, label="simulated")
    ax.set(xlim=(begin, found.time[-1]), ylabel="mm", xlabel="time [s]", title=title)


def _over_time(ax: Axes, found: Agreement, title: str) -> None:
    ax.set(xlim=(found.time[0], found.time[-1]), xlabel="time [s]", ylabel="mm", title=title)
