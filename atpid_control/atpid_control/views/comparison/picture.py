# SPDX-License-Identifier: Apache-2.0
"""The picture of two bags: beams overlaid, their difference, excitation, ceiling, spectra, the last periods."""

from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.views.comparison.compare import Compared, RunOnAxis
from atpid_control.views.report.panels import extremes
from atpid_sim.figure_numbers import drawn, light_frames

#: Points of a curve at most; seconds shown close up; decades of a density.
_POINTS, _CLOSE_UP, _DECADES = 20_000, 1.2, 1e-9
_COLOURS = ("0.55", "C0")
#: The first is wider, so that it is seen below a second that is the same.
_WIDTHS = (2.4, 0.8)


def draw(found: Compared, path: Path) -> None:
    """Draw the comparison as PNG. Raises OutputError."""
    layout = [["beam", "beam"], ["difference", "difference"], ["support", "ceiling"], ["close", "spectrum"]]
    with drawn(path, "--out", dpi=110, mosaic=layout, figsize=(13.0, 13.0)) as (_, axes):
        light_frames(axes.values())
        begin, end = float(found.time[0]), float(found.time[-1])
        _beams(axes["beam"], found, -np.inf, np.inf, "Beam displacement")
        shown = extremes(found.difference, _POINTS)
        axes["difference"].plot(found.time[shown], found.difference[shown], "C3", linewidth=0.7)
        axes["difference"].set(xlim=(begin, end), xlabel="time [s]", ylabel="m", title="Beam, second less first")
        for placed, colour, width in zip(found.runs, _COLOURS, _WIDTHS, strict=True):
            _settings(axes, placed, colour, width)
        axes["support"].set(xlabel="time [s]", ylabel="m", title="Support amplitude, identified")
        axes["ceiling"].set(xlabel="time [s]", ylabel="m", title="Ceiling height, measured")
        _beams(axes["close"], found, end - _CLOSE_UP, end, f"The last {_CLOSE_UP} s")
        _spectra(axes["spectrum"], found)


def _beams(ax: Any, found: Compared, begin: float, end: float, title: str) -> None:
    for placed, colour, width, place in zip(found.runs, _COLOURS, _WIDTHS, ("first", "second"), strict=True):
        inside = (placed.time >= begin) & (placed.time <= end)
        time, beam = placed.time[inside], placed.signals.response[inside]
        shown = extremes(beam, _POINTS)
        ax.plot(time[shown], beam[shown], colour, linewidth=width, label=f"{place}: {Path(placed.name).name}")
    ax.set(xlabel="time [s]", ylabel="m", title=title)
    ax.legend(fontsize=8, loc="upper right")


def _settings(axes: Any, placed: RunOnAxis, colour: str, width: float) -> None:
    run = placed.view.run
    steady = run.estimates.steady
    time, amplitude = run.estimates.time[steady] + placed.shift, run.estimates.amplitude[steady]
    axes["support"].plot(time, amplitude, ".", color=colour, markersize=4.0 * width)
    axes["ceiling"].plot(run.ceiling.time + placed.shift, run.ceiling.height, color=colour, linewidth=width)


def _spectra(ax: Any, found: Compared) -> None:
    top = right = 0.0
    for placed, colour in zip(found.runs, _COLOURS, strict=True):
        if placed.spectrum is None:
            continue
        frequency, density = placed.spectrum.frequency[1:], placed.spectrum.density[1:]
        ax.semilogy(frequency, density, color=colour, linewidth=1.0)
        top = max(top, float(density.max()))
        total = np.cumsum(density)
        right = max(right, 8.0 * float(frequency[np.searchsorted(total, 0.5 * total[-1])]))
    if top > 0.0:
        ax.set(ylim=(_DECADES * top, 3.0 * top), xlim=(0.0, right))
    ax.set(xlabel="frequency [Hz]", ylabel="m$^2$/Hz", title="Power spectral density of the beam")
