# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag compare A B --out DIR`: two recorded runs overlaid, their differences in a table."""

import argparse
import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from atpid_common.arguments import file_path, word
from atpid_control.analysis.rows import shown_unit
from atpid_control.commands.results import Shown, add_results, claim, give
from atpid_control.runs.formats import bag_of
from atpid_control.views.report.panels import extremes
from atpid_lab.comparison.compare import CLOCK, START, Compared, Row, RunOnAxis, compare_bags
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, Panels

PICTURE, NUMBERS = "bags.png", "bags.json"

#: Arguments of the example in the help.
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
        shown.add_row(f"{row.name}{unit and f' [{unit}]'}", *_cells(row, scale))
    return shown


def _cells(row: Row, scale: float) -> list[str]:
    values = zip((row.first, row.second, row.difference), (*row.spreads, math.hypot(*row.spreads)), strict=True)
    relative = f"{100.0 * row.relative:+.2f} %" if math.isfinite(row.relative) else ""
    return [*(_value(scale * value, scale * spread) for value, spread in values), relative]


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
    rows = ((_beam,), (_last,), (_difference,), (_excitation, _ceiling), (_spectra,))
    return [[partial(drawer, found=found) for drawer in row] for row in rows]


def _looks(found: Compared) -> Iterator[tuple[RunOnAxis, dict[str, Any]]]:
    """Yield each run with the look of its lines."""
    for placed, colour, width in zip(found.runs, _COLOURS, _WIDTHS, strict=True):
        yield placed, {"color": colour, "linewidth": width, "label": placed.label}


def _period(found: Compared) -> float:
    return 1.0 / min((placed.orders.frequency for placed in found.runs if placed.orders is not None), default=5.0)


def _beam(ax: Any, found: Compared) -> None:
    """Draw the highest and lowest of each stretch, so that neither run hides the other."""
    stretch = max(_period(found), float(np.ptp(found.time)) / _STRETCHES)
    for placed, look in _looks(found):
        edges = np.arange(placed.time[0], placed.time[-1], stretch)
        parts = np.split(1e3 * placed.signals.response, np.searchsorted(placed.time, edges[1:]))[:-1]  # the last is cut
        known = [part[np.isfinite(part)] for part in parts]
        for extreme, name in ((np.max, placed.label), (np.min, None)):
            value = [extreme(part) if len(part) else np.nan for part in known]
            ax.plot(edges[:-1] + 0.5 * stretch, value, **look | {"label": name})
    ax.set(xlabel="time [s]", ylabel="mm", title="Beam: highest and lowest of each period")


def _last(ax: Any, found: Compared) -> None:
    end = float(found.time[-1])
    begin = end - _CLOSE_UP * _period(found)
    for placed, look in _looks(found):
        inside = (placed.time >= begin) & (placed.time <= end)
        time, beam = placed.time[inside], placed.signals.response[inside]
        shown = extremes(beam, _POINTS)
        ax.plot(time[shown], 1e3 * beam[shown], **look)
    ax.set(xlim=(begin, end), xlabel="time [s]", ylabel="mm", title=f"Beam, the last {_CLOSE_UP:g} periods")


def _difference(ax: Any, found: Compared) -> None:
    shown = extremes(found.difference, _POINTS)
    ax.plot(found.time[shown], 1e3 * found.difference[shown], color=LIGHT.ink, linewidth=0.7)
    ends = (float(found.time[0]), float(found.time[-1]))
    ax.set(xlim=ends, xlabel="time [s]", ylabel="mm", title="Beam, second less first")


def _excitation(ax: Any, found: Compared) -> None:
    for placed, look in _looks(found):
        run, scale = placed.view.run, shown_unit(placed.view.run.drive.unit)[0]
        steady = run.estimates.steady
        ax.plot(run.estimates.time[steady] + placed.shift, scale * run.estimates.amplitude[steady], ".",
                markersize=3.0 * look["linewidth"], **look)  # fmt: skip
    drives = dict.fromkeys(placed.view.run.drive for placed in found.runs)
    title = f"{' and '.join(drive.name for drive in drives)} amplitude, identified".capitalize()
    ax.set(xlabel="time [s]", ylabel=" and ".join(shown_unit(drive.unit)[1] for drive in drives), title=title)


def _ceiling(ax: Any, found: Compared) -> None:
    for placed, look in _looks(found):
        ceiling = placed.view.run.ceiling
        ax.plot(ceiling.time + placed.shift, 1e3 * ceiling.height, **look)
    ax.set(xlabel="time [s]", ylabel="mm", title="Ceiling height, measured")


def _spectra(ax: Any, found: Compared) -> None:
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
