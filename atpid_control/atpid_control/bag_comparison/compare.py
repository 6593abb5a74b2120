# SPDX-License-Identifier: Apache-2.0
"""Two recorded runs on one time axis: by the start of their samples, by the clock of the hardware, or by an event."""

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.errors import InputError
from atpid_control.analysis.orders import Orders, orders, steady_part
from atpid_control.analysis.signals import AnalysisError, Signals
from atpid_control.analysis.spectra import Spectrum, spectrum
from atpid_control.bags.read import Bag, stamp_of
from atpid_control.report.analysis import signals_of
from atpid_control.report.latency import latency_of
from atpid_control.report.stages import half_range
from atpid_control.report.view import View, view_of
from atpid_sim.system import Array

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

    @property
    def difference(self) -> float:
        """The second less the first."""
        return self.second - self.first

    @property
    def relative(self) -> float:
        """The difference over the first [-]; NaN where that is 0."""
        return self.difference / abs(self.first) if self.first else math.nan


@dataclass(frozen=True)
class Side:
    """One of the two runs."""

    name: str
    view: View
    signals: Signals  # support and beam, NaN where a sample was lost
    shift: float  # to be added to its times [s]
    spectrum: Spectrum | None
    orders: Orders | None

    @property
    def time(self) -> Array:
        """Times of its signals on the common axis (n,) [s]."""
        return np.asarray(self.signals.time + self.shift)


@dataclass(frozen=True)
class Compared:
    """Two runs beside each other."""

    sides: tuple[Side, Side]
    aligned_by: str
    rows: list[Row]
    time: Array  # (n,) the common part [s]
    difference: Array  # (n,) beam of the second less that of the first [m]
    doubts: tuple[str, ...]
    missing: tuple[str, ...]  # what is not in the bags and should be

    def to_json(self) -> dict[str, Any]:
        """Return the numbers as plain values."""
        rows = [
            {"name": row.name, "unit": row.unit, "first": row.first, "second": row.second,
             "difference": row.difference, "relative": row.relative}
            for row in self.rows
        ]  # fmt: skip
        return {"bags": [side.name for side in self.sides], "aligned_by": self.aligned_by,
                "shifts": [side.shift for side in self.sides], "rows": rows, "doubts": list(self.doubts),
                "missing": list(self.missing)}  # fmt: skip


def compare_bags(first: Path, second: Path, align: str = START) -> Compared:
    """Return two bags beside each other, aligned by `start`, `clock` or the first event of a kind.

    Raises BagError, BagComparisonError: no such event, or no common time.
    """
    views = [view_of(path) for path in (first, second)]
    shifts = _shifts(views, (first, second), align)
    sides = [_side(path, view, shift) for path, view, shift in zip((first, second), views, shifts, strict=True)]
    time, difference = _difference(sides, align)
    rows = [*_rows(sides), *_difference_rows(sides, difference)]
    return Compared((sides[0], sides[1]), align, rows, time, difference, tuple(_doubts(sides)), tuple(_missing(sides)))


def _side(path: Path, view: View, shift: float) -> Side:
    signals = signals_of(view.run.motion)
    found: Orders | None = None
    density: Spectrum | None = None
    with suppress(AnalysisError):  # a run too short, or without excitation: its rows are missing in the table
        density = spectrum(signals.response, signals.rate)
        found = orders(steady_part(signals))
    return Side(str(path), view, signals, shift, density, found)


def _shifts(views: list[View], paths: tuple[Path, Path], align: str) -> list[float]:
    """Return what to add to the times of each run [s]."""
    if align == START:
        return [0.0, 0.0]
    if align == CLOCK:
        starts = [_start_ns(view.run.bag) for view in views]
        return [0.0, (starts[1] - starts[0]) * 1e-9]
    times = []
    for view, path in zip(views, paths, strict=True):
        at = [event.time for event in view.run.events if event.kind == align]
        if not at:
            kinds = ", ".join(sorted({event.kind for event in view.run.events})) or "none"
            raise BagComparisonError(f"{path}: --align: no event {align!r}; in this bag: {kinds}; or {START}, {CLOCK}")
        times.append(at[0])
    return [0.0, times[0] - times[1]]


def _start_ns(bag: Bag) -> int:
    """Return the stamp of the first block of displacements [ns]."""
    return min(stamp_of(block) for topic in bag.topics_of("SampleBlock") for _, block in bag.messages(topic))


def _difference(sides: list[Side], align: str) -> tuple[Array, Array]:
    """Return the common times (n,) [s] and the difference of the beams there (n,) [m], NaN in a gap of one of them."""
    times = [side.time for side in sides]
    begin, end = max(time[0] for time in times), min(time[-1] for time in times)
    if end - begin < _OVERLAP:
        spans = "; ".join(f"{time[0]:.6g} to {time[-1]:.6g} s" for time in times)
        raise BagComparisonError(f"--align: given {align}; the two runs have no common time ({spans}); give {START}")
    common = times[0][(times[0] >= begin) & (times[0] <= end)]
    # between two samples of which one is lost the result is NaN too
    beams = [np.interp(common, time, side.signals.response) for time, side in zip(times, sides, strict=True)]
    return common, np.asarray(beams[1] - beams[0])


def _rows(sides: list[Side]) -> Iterator[Row]:
    """Yield what both runs have, side by side."""
    first, second = (side.view for side in sides)
    yield Row("duration", "s", first.run.duration, second.run.duration)
    yield Row("beam, half peak-to-peak", "m", half_range(first.beam), half_range(second.beam))
    for number, stages in enumerate(zip_longest(first.stages, second.stages), 1):
        for name, unit, field in (
            ("excitation, true", "m", "excitation_amplitude"), ("excitation, identified", "m", "identified_amplitude"),
            ("frequency, identified", "Hz", "identified_frequency"), ("ceiling height", "m", "height"),
            ("beam amplitude", "m", "amplitude"), ("beam, closed damper", "m", "undamped_amplitude"),
            ("efficiency", "-", "efficiency"),
        ):  # fmt: skip
            values = [math.nan if stage is None else float(getattr(stage, field)) for stage in stages]
            yield Row(f"stage {number}: {name}", unit, *values)
    yield from _order_rows(sides)
    if first.decrements or second.decrements:
        yield Row("largest ratio of successive peaks", "-", *(v.decrements[0] if v.decrements else math.nan
                                                             for v in (first, second)))  # fmt: skip
    bags = [view.run.bag for view in (first, second)]
    delays = [latency_of(bag) if bag.run.get("clock") == "real time" else {} for bag in bags]
    if any(delays):
        for name in ("p50", "p99", "max"):
            values = [delay["sample_to_command"][name] if delay else math.nan for delay in delays]
            yield Row(f"sample to command, {name}", "s", *values)
    yield Row("samples lost", "", float(first.run.lost), float(second.run.lost))
    counts = [Counter(event.kind for event in view.run.events for _ in range(event.count)) for view in (first, second)]
    for kind in sorted(counts[0] | counts[1]):
        yield Row(f"events: {kind}", "", float(counts[0][kind]), float(counts[1][kind]))


def _order_rows(sides: list[Side]) -> Iterator[Row]:
    found = [side.orders for side in sides]
    if any(found):
        amplitudes = [math.nan if one is None else float(one.amplitude[0]) for one in found]
        yield Row("order 1 of the beam, last part", "m", *amplitudes)
        yield Row("distortion (THD), last part", "-", *(math.nan if one is None else one.distortion for one in found))


def _difference_rows(sides: list[Side], difference: Array) -> Iterator[Row]:
    known = difference[np.isfinite(difference)]
    size = float(np.nanstd(sides[0].view.run.motion.beam))
    root = float(np.sqrt(np.mean(known**2))) if len(known) else math.nan
    yield Row("beam, second less first, root mean square", "m", 0.0, root)
    yield Row("the same over the first's standard deviation", "-", 0.0, root / size if size > 0.0 else math.nan)


def _missing(sides: list[Side]) -> Iterator[str]:
    for side in sides:
        yield from side.view.run.bag.missing


def _doubts(sides: list[Side]) -> Iterator[str]:
    for side in sides:
        run = side.view.run
        if run.lost:
            yield f"{side.name}: {run.lost} samples lost"
        yield from (f"{side.name}: {line}" for line in run.left_out)
        if any(stage.reproducible is False for stage in side.view.stages):
            yield f"{side.name}: irregular motion: single runs differ, so that a difference may be chance"
        if run.bag.result.get("finished") != "yes" and not run.bag.missing:
            yield f"{side.name}: the recording ended before the run did"
    counts = [len(side.view.stages) for side in sides]
    if counts[0] != counts[1]:
        yield f"{counts[0]} stages in the first, {counts[1]} in the second: those without a partner have no difference"
