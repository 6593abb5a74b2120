# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag compare A B --out DIR`: two recorded runs on one time axis, overlaid, their differences in a table.

The axis is common by the start of their samples, by the clock of the hardware, or by an event.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from atpid_common.arguments import file_path, word
from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_control.analysis.orders import Orders, orders, steady_part
from atpid_control.analysis.rows import shown_unit
from atpid_control.analysis.signals import AnalysisError, Signals, signals_of
from atpid_control.analysis.spectra import Spectrum, spectrum
from atpid_control.commands.results import Shown, add_results, claim, give
from atpid_control.runs.formats import bag_of
from atpid_control.runs.run import open_run
from atpid_control.views.report.latency import latency_of
from atpid_control.views.report.panels import extremes
from atpid_control.views.report.stages import Stage
from atpid_control.views.report.view import View, origin_of, view_of
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, Panels
from atpid_sim.simulation.quantities import half_peak_to_peak
from atpid_sim.system import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: How runs are aligned, besides by the kind of an event.
START, CLOCK = "start", "clock"
#: Least overlap of two runs on one time axis [s].
_OVERLAP = 0.1


class BagComparisonError(InputError):
    """Two bags that cannot be compared: what was given, what is there, what to do."""


@dataclass(frozen=True)
class Row:
    """One quantity of both runs; NaN: not known in one of them."""

    name: str
    unit: str
    first: float
    second: float
    spreads: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)  # half the range of single runs

    @property
    def difference(self) -> float:
        """The second less the first."""
        return self.second - self.first

    @property
    def relative(self) -> float:
        """The difference over the first [-]; NaN where that is 0."""
        return self.difference / abs(self.first) if self.first else math.nan


@dataclass(frozen=True)
class _RunOnAxis:
    """One of the two runs."""

    name: str
    label: str  # the scene and when it was recorded, else the folder
    view: View
    signals: Signals  # support and beam, NaN where a sample was lost
    shift: float  # to be added to its times [s]
    spectrum: Spectrum | None
    orders: Orders | None
    missing: tuple[str, ...]  # what is not in the bag and should be

    @property
    def time(self) -> Array:
        """Times of its signals on the common axis (n,) [s]."""
        return np.asarray(self.signals.time + self.shift)


@dataclass(frozen=True)
class Compared:
    """Two runs beside each other."""

    runs: tuple[_RunOnAxis, _RunOnAxis]
    aligned_by: str
    rows: list[Row]
    time: Array  # (n,) the common part [s]
    difference: Array  # (n,) beam of the second less that of the first [m]
    doubts: tuple[str, ...]

    def to_json(self) -> Document:
        """Return the numbers as plain values."""
        return {
            "bags": [placed.name for placed in self.runs],
            "origin": [placed.signals.origin for placed in self.runs],
            "aligned_by": self.aligned_by,
            "shifts": [placed.shift for placed in self.runs],
            "rows": [asdict(row) | {"difference": row.difference, "relative": row.relative} for row in self.rows],
            "doubts": self.doubts,
            "missing": [line for placed in self.runs for line in placed.missing],
        }


def compare_bags(first: Path, second: Path, align: str = START) -> Compared:
    """Return two bags beside each other, aligned by `start`, `clock` or the first event of a kind.

    Raises BagError, BagComparisonError: no such event, or no common time.
    """
    # sensors only, so that a simulated run and a measured one are compared by the same reading
    views = [view_of(replace(open_run(path), prefer="")) for path in (first, second)]
    shifts = _shifts(views, (first, second), align)
    labels = _labels(views, (first, second))
    placed = zip((first, second), labels, views, shifts, strict=True)
    runs = [_placed(*parts) for parts in placed]
    time, difference = _difference(runs, align)
    return Compared((runs[0], runs[1]), align, list(_rows(runs, difference)), time, difference, tuple(_doubts(runs)))


def _labels(views: list[View], paths: tuple[Path, Path]) -> list[str]:
    named = list(map(str, paths))
    labels = [
        " · ".join(origin_of(view)[:2]) if "scene" in view.run.about else name
        for view, name in zip(views, named, strict=True)
    ]
    return labels if labels[0] != labels[1] else named


def _placed(path: Path, label: str, view: View, shift: float) -> _RunOnAxis:
    signals, missing = signals_of(view.run, both=False)
    found: Orders | None = None
    density: Spectrum | None = None
    with suppress(AnalysisError):  # a run too short, or without excitation: its rows are missing in the table
        density = spectrum(signals.response, signals.rate)
        found = orders(steady_part(signals))
    return _RunOnAxis(str(path), label, view, signals, shift, density, found, tuple(missing))


def _shifts(views: list[View], paths: tuple[Path, Path], align: str) -> list[float]:
    """Return what to add to the times of each run [s]."""
    if align == START:
        return [0.0, 0.0]
    if align == CLOCK:
        starts = [view.run.start_ns for view in views]
        return [0.0, (starts[1] - starts[0]) * 1e-9]
    times = []
    for view, path in zip(views, paths, strict=True):
        at = [event.time for event in view.run.events if event.kind == align]
        if not at:
            kinds = ", ".join(sorted({event.kind for event in view.run.events})) or "none"
            raise BagComparisonError(f"{path}: --align: no event {align!r}; in this bag: {kinds}; or {START}, {CLOCK}")
        times.append(at[0])
    return [0.0, times[0] - times[1]]


def _difference(runs: list[_RunOnAxis], align: str) -> tuple[Array, Array]:
    """Return the common times (n,) [s] and the difference of the beams there (n,) [m], NaN in a gap of one of them."""
    times = [placed.time for placed in runs]
    begin, end = max(time[0] for time in times), min(time[-1] for time in times)
    if end - begin < _OVERLAP:
        spans = "; ".join(f"{time[0]:.6g} to {time[-1]:.6g} s" for time in times)
        raise BagComparisonError(f"--align: given {align}; the two runs have no common time ({spans}); give {START}")
    common = times[0][(times[0] >= begin) & (times[0] <= end)]
    # between two samples of which one is lost the result is NaN too
    beams = [np.interp(common, time, placed.signals.response) for time, placed in zip(times, runs, strict=True)]
    return common, np.asarray(beams[1] - beams[0])


def _half(limits: tuple[float, float]) -> float:
    return 0.5 * (limits[1] - limits[0])


#: Each quantity of a stage: its name, unit (empty: the drive's), value and half the range of single runs.
_STAGE: tuple[tuple[str, str, Callable[[Stage], tuple[float, float]]], ...] = (
    ("excitation, true", "", lambda stage: (stage.excitation_amplitude, 0.0)),
    ("excitation, identified", "", lambda stage: (stage.identified_amplitude, 0.0)),
    ("frequency, identified", "Hz", lambda stage: (stage.identified_frequency, 0.0)),
    ("ceiling height", "m", lambda stage: (stage.height, 0.0)),
    ("beam amplitude", "m", lambda stage: (stage.amplitude, _half(stage.amplitude_spread or (0.0, 0.0)))),
    ("beam, closed damper", "m", lambda stage: (stage.undamped_amplitude, 0.0)),
    ("efficiency", "-", lambda stage: (stage.efficiency, _half(stage.efficiency_range))),
    ("beam, without damper", "m", lambda stage: (stage.bare_amplitude, 0.0)),
    ("reduction", "-", lambda stage: (stage.reduction, _half(stage.reduction_range))),
)


def _rows(runs: list[_RunOnAxis], difference: Array) -> Iterator[Row]:
    """Yield what both runs have, side by side; last how their beams differ (n,) [m]."""
    first, second = (placed.view for placed in runs)
    drives = list(dict.fromkeys(placed.view.run.drive for placed in runs))
    yield Row("duration", "s", first.run.duration, second.run.duration)
    yield Row("beam, half peak-to-peak", "m", half_peak_to_peak(first.beam), half_peak_to_peak(second.beam))
    for number, stages in enumerate(zip_longest(first.stages, second.stages), 1):
        for name, unit, value in _STAGE:
            if not unit and len(drives) > 1:
                continue  # a displacement and a force are not compared
            pairs = [(math.nan, 0.0) if stage is None else value(stage) for stage in stages]
            (one, scatter), (other, others) = pairs
            yield Row(f"stage {number}: {name}", unit or drives[0].unit, one, other, spreads=(scatter, others))
    found = [placed.orders for placed in runs]
    if any(found):
        amplitudes = [math.nan if one is None else float(one.amplitude[0]) for one in found]
        yield Row("order 1 of the beam, last part", "m", *amplitudes)
        yield Row("distortion (THD), last part", "-", *(math.nan if one is None else one.distortion for one in found))
    if first.decrements or second.decrements:
        ratios = (view.decrements[0] if view.decrements else math.nan for view in (first, second))
        yield Row("largest ratio of successive peaks", "-", *ratios)
    recorded = [view.run for view in (first, second)]
    delays = [latency_of(run) if run.about.get("clock") == "real time" else {} for run in recorded]
    if any(delays):
        for name in ("p50", "p99", "max"):
            values = [delay["sample_to_command"][name] if delay else math.nan for delay in delays]
            yield Row(f"sample to command, {name}", "s", *values)
    yield Row("samples lost", "", float(first.run.lost), float(second.run.lost))
    counts = [Counter(event.kind for event in view.run.events for _ in range(event.count)) for view in (first, second)]
    for kind in sorted(counts[0] | counts[1]):
        yield Row(f"events: {kind}", "", float(counts[0][kind]), float(counts[1][kind]))
    known = difference[np.isfinite(difference)]
    size = float(np.nanstd(runs[0].view.run.motion.beam))
    root = float(np.sqrt(np.mean(known**2))) if len(known) else math.nan
    yield Row("beam, second less first, root mean square", "m", 0.0, root)
    yield Row("the same over the first's standard deviation", "-", 0.0, root / size if size > 0.0 else math.nan)


def _doubts(runs: list[_RunOnAxis]) -> Iterator[str]:
    for placed in runs:
        run = placed.view.run
        if run.lost:
            yield f"{placed.name}: {run.lost} samples lost"
        if any(stage.reproducible is False for stage in placed.view.stages):
            yield f"{placed.name}: irregular motion: single runs differ (±), so that a difference may be chance"
        if run.result.get("finished", "yes") != "yes" and not run.unread:  # of another recorder that is not known
            yield f"{placed.name}: the recording ended before the run did"
    first, second = (placed.view.run.drive for placed in runs)
    if first is not second:
        yield f"a {first.name} drives the first, a {second.name} the second: their excitations are not compared"
    counts = [len(placed.view.stages) for placed in runs]
    if counts[0] != counts[1]:
        yield f"{counts[0]} stages in the first, {counts[1]} in the second: those without a partner have no difference"


PICTURE, NUMBERS = "bags.png", "bags.json"

EXAMPLE = "bags/thesis_4_3_short bags/rumble --out out/two"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("first", type=file_path, metavar="A", help="folder of the first bag; of one that is cut off what is there")
    add("second", type=file_path, metavar="B", help="folder of the second bag")
    add_results(parser)
    align = f"common time 0: {START} of the samples, {CLOCK} of the hardware, or a kind of event; default: {START}"
    add("--align", type=word, default=START, metavar="BY", help=align)


def run(args: argparse.Namespace) -> int:
    """Compare, write picture and numbers, print; return 0. Raises BagError, BagComparisonError, OutputError."""
    bags = bag_of(args.first), bag_of(args.second)
    picture, file = claim(args, PICTURE, NUMBERS)
    with working("reading both, repeating their stages by simulation"):
        found = compare_bags(*bags, args.align)
    notes = [f"note: {line}" for line in found.doubts]
    first, second = (placed.label for placed in found.runs)
    title = f"{first} (first) beside {second} (second), aligned by {found.aligned_by}"
    return give(args, found.to_json(), file, Shown(title, table(found), notes, picture, panels(found)))


def table(found: Compared) -> Table:
    """Return the differences as a table, lengths in mm; ±: half the spread of single runs of an irregular motion."""
    shown = Table(box=SIMPLE_HEAD, pad_edge=False)
    shown.add_column("quantity")
    for name in ("first", "second", "difference", "relative"):
        shown.add_column(name, justify="right", no_wrap=True)
    shown.add_row("origin of the samples", *(placed.signals.origin for placed in found.runs))
    for row in found.rows:
        scale, unit = (1e3, "mm") if row.unit == "m" else (1.0, row.unit)
        values = zip((row.first, row.second, row.difference), (*row.spreads, math.hypot(*row.spreads)), strict=True)
        cells = (_value(scale * value, scale * spread) for value, spread in values)
        relative = f"{100.0 * row.relative:+.2f} %" if math.isfinite(row.relative) else ""
        shown.add_row(f"{row.name}{unit and f' [{unit}]'}", *cells, relative)
    return shown


def _value(value: float, spread: float) -> str:
    if not math.isfinite(value):
        return "–"
    if not spread:
        return f"{value:.5g}"
    digits = max(0, 1 - math.floor(math.log10(spread)))  # two of the spread
    return f"{value:.{digits}f} ± {spread:.{digits}f}"


#: Points of a curve at most; periods shown close up; decades of a density; stretches of an envelope.
_POINTS, _CLOSE_UP, _DECADES, _STRETCHES = 20_000, 6.0, 1e-9, 400
_COLOURS = (LIGHT.accent, LIGHT.own)
#: The first is wider, so that it is seen below a second that is the same.
_WIDTHS = (2.6, 1.0)


def panels(found: Compared) -> Panels:
    """Return the panels of a comparison."""
    rows = ((_beam,), (_last,), (_beside,), (_excitation, _ceiling), (_spectra,))
    return [[partial(drawer, found=found) for drawer in row] for row in rows]


def _looks(found: Compared) -> Iterator[tuple[_RunOnAxis, Document]]:
    """Yield each run with the look of its lines."""
    for placed, colour, width in zip(found.runs, _COLOURS, _WIDTHS, strict=True):
        yield placed, {"color": colour, "linewidth": width, "label": placed.label}


def _period(found: Compared) -> float:
    return 1.0 / min((placed.orders.frequency for placed in found.runs if placed.orders is not None), default=5.0)


def _beam(ax: Axes, found: Compared) -> None:
    """Draw the highest and lowest of each stretch, so that neither run hides the other."""
    stretch = max(_period(found), float(np.ptp(found.time)) / _STRETCHES)
    for placed, look in _looks(found):
        edges = np.arange(placed.time[0], placed.time[-1], stretch)
        parts = np.split(1e3 * placed.signals.response, np.searchsorted(placed.time, edges[1:]))[:-1]  # the last is cut
        known = [part[np.isfinite(part)] for part in parts]
        for extreme, shown in ((np.max, look), (np.min, look | {"label": None})):
            value = [extreme(part) if len(part) else np.nan for part in known]
            ax.plot(edges[:-1] + 0.5 * stretch, value, **shown)
    ax.set(xlabel="time [s]", ylabel="mm", title="Beam: highest and lowest of each period")


def _last(ax: Axes, found: Compared) -> None:
    end = float(found.time[-1])
    begin = end - _CLOSE_UP * _period(found)
    for placed, look in _looks(found):
        inside = (placed.time >= begin) & (placed.time <= end)
        time, beam = placed.time[inside], placed.signals.response[inside]
        shown = extremes(beam, _POINTS)
        ax.plot(time[shown], 1e3 * beam[shown], **look)
    ax.set(xlim=(begin, end), xlabel="time [s]", ylabel="mm", title=f"Beam, the last {_CLOSE_UP:g} periods")


def _beside(ax: Axes, found: Compared) -> None:
    shown = extremes(found.difference, _POINTS)
    ax.plot(found.time[shown], 1e3 * found.difference[shown], color=LIGHT.ink, linewidth=0.7)
    ends = (float(found.time[0]), float(found.time[-1]))
    ax.set(xlim=ends, xlabel="time [s]", ylabel="mm", title="Beam, second less first")


def _excitation(ax: Axes, found: Compared) -> None:
    for placed, look in _looks(found):
        run, scale = placed.view.run, shown_unit(placed.view.run.drive.unit)[0]
        steady = run.estimates.steady
        time, amplitude = run.estimates.time[steady] + placed.shift, scale * run.estimates.amplitude[steady]
        ax.plot(time, amplitude, ".", markersize=3.0 * look["linewidth"], **look)
    drives = dict.fromkeys(placed.view.run.drive for placed in found.runs)
    title = f"{' and '.join(drive.name for drive in drives)} amplitude, identified".capitalize()
    ax.set(xlabel="time [s]", ylabel=" and ".join(shown_unit(drive.unit)[1] for drive in drives), title=title)


def _ceiling(ax: Axes, found: Compared) -> None:
    for placed, look in _looks(found):
        ceiling = placed.view.run.ceiling
        ax.plot(ceiling.time + placed.shift, 1e3 * ceiling.height, **look)
    ax.set(xlabel="time [s]", ylabel="mm", title="Ceiling height, measured")


def _spectra(ax: Axes, found: Compared) -> None:
    top = right = 0.0
    for placed, look in _looks(found):
        if placed.spectrum is None:
            continue
        frequency, density = placed.spectrum.frequency[1:], placed.spectrum.density[1:]
        ax.semilogy(frequency, density, **look)
        top = max(top, float(density.max()))
        total = np.cumsum(density)
        right = max(right, 8.0 * float(frequency[np.searchsorted(total, 0.5 * total[-1])]))
    if top > 0.0:
        ax.set(ylim=(_DECADES * top, 3.0 * top), xlim=(0.0, right))
    ax.set(xlabel="frequency [Hz]", ylabel="m²/Hz", title="Power spectral density of the beam")
