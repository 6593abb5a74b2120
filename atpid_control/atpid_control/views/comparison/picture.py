# SPDX-License-Identifier: Apache-2.0
"""The picture of two bags: envelopes, the last periods and difference of the beams, excitation, ceiling, spectra."""

from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.analysis.rows import shown_unit
from atpid_control.views.comparison.compare import Compared, RunOnAxis
from atpid_control.views.report.panels import extremes
from atpid_sim.figure_numbers import drawn
from atpid_sim.figure_style import LIGHT

#: Points of a curve at most; periods shown close up; decades of a density; stretches of an envelope.
_POINTS, _CLOSE_UP, _DECADES, _STRETCHES = 20_000, 6.0, 1e-9, 400
_COLOURS = (LIGHT.accent, LIGHT.own)
#: The first is wider, so that it is seen below a second that is the same.
_WIDTHS = (2.6, 1.0)


def draw(found: Compared, path: Path) -> None:
    """Draw the comparison as PNG. Raises OutputError."""
    layout = [["beam", "beam"], ["close", "close"], ["difference", "difference"], ["support", "ceiling"],
              ["spectrum", "spectrum"]]  # fmt: skip
    with drawn(path, "--out", dpi=110, mosaic=layout, figsize=(11.0, 14.0)) as (figure, axes):
        begin, end = float(found.time[0]), float(found.time[-1])
        shown = extremes(found.difference, _POINTS)
        axes["difference"].plot(found.time[shown], 1e3 * found.difference[shown], color=LIGHT.ink, linewidth=0.7)
        axes["difference"].set(xlim=(begin, end), xlabel="time [s]", ylabel="mm", title="Beam, second less first")
        frequencies = [placed.orders.frequency for placed in found.runs if placed.orders is not None]
        period = 1.0 / min(frequencies, default=5.0)
        for placed, colour, width in zip(found.runs, _COLOURS, _WIDTHS, strict=True):
            _envelope(axes["beam"], placed, max(period, (end - begin) / _STRETCHES), colour, width)
            _last(axes["close"], placed, end - _CLOSE_UP * period, end, colour, width)
            _settings(axes, placed, colour, width)
        axes["beam"].set(xlabel="time [s]", ylabel="mm", title="Beam: highest and lowest of each period")
        title = f"Beam, the last {_CLOSE_UP:g} periods"
        axes["close"].set(xlim=(end - _CLOSE_UP * period, end), xlabel="time [s]", ylabel="mm", title=title)
        drives = dict.fromkeys(placed.view.run.drive for placed in found.runs)
        unit = " and ".join(shown_unit(drive.unit)[1] for drive in drives)
        title = f"{' and '.join(drive.name for drive in drives)} amplitude, identified".capitalize()
        axes["support"].set(xlabel="time [s]", ylabel=unit, title=title)
        axes["ceiling"].set(xlabel="time [s]", ylabel="mm", title="Ceiling height, measured")
        _spectra(axes["spectrum"], found)
        figure.legend(*axes["beam"].get_legend_handles_labels(), loc="outside upper left", fontsize=10)


def _envelope(ax: Any, placed: RunOnAxis, stretch: float, colour: str, width: float) -> None:
    """Draw the highest and lowest of each stretch [s], so that neither run hides the other."""
    edges = np.arange(placed.time[0], placed.time[-1], stretch)
    parts = np.split(1e3 * placed.signals.response, np.searchsorted(placed.time, edges[1:]))[:-1]  # the last is cut off
    known = [part[np.isfinite(part)] for part in parts]
    for extreme, name in ((np.max, placed.label), (np.min, None)):
        value = [extreme(part) if len(part) else np.nan for part in known]
        ax.plot(edges[:-1] + 0.5 * stretch, value, color=colour, linewidth=width, label=name)


def _last(ax: Any, placed: RunOnAxis, begin: float, end: float, colour: str, width: float) -> None:
    inside = (placed.time >= begin) & (placed.time <= end)
    time, beam = placed.time[inside], placed.signals.response[inside]
    shown = extremes(beam, _POINTS)
    ax.plot(time[shown], 1e3 * beam[shown], color=colour, linewidth=width)


def _settings(axes: Any, placed: RunOnAxis, colour: str, width: float) -> None:
    run = placed.view.run
    steady = run.estimates.steady
    time, amplitude = run.estimates.time[steady] + placed.shift, run.estimates.amplitude[steady]
    axes["support"].plot(time, shown_unit(run.drive.unit)[0] * amplitude, ".", color=colour, markersize=3.0 * width)
    axes["ceiling"].plot(run.ceiling.time + placed.shift, 1e3 * run.ceiling.height, color=colour, linewidth=width)


def _spectra(ax: Any, found: Compared) -> None:
    top = right = 0.0
    for placed, colour, width in zip(found.runs, _COLOURS, _WIDTHS, strict=True):
        if placed.spectrum is None:
            continue
        frequency, density = placed.spectrum.frequency[1:], placed.spectrum.density[1:]
        ax.semilogy(frequency, density, color=colour, linewidth=width)
        top = max(top, float(density.max()))
        total = np.cumsum(density)
        right = max(right, 8.0 * float(frequency[np.searchsorted(total, 0.5 * total[-1])]))
    if top > 0.0:
        ax.set(ylim=(_DECADES * top, 3.0 * top), xlim=(0.0, right))
    ax.set(xlabel="frequency [Hz]", ylabel="m$^2$/Hz", title="Power spectral density of the beam")
