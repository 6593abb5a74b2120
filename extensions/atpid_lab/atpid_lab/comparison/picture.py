# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The panels of two bags: envelopes, the last periods and difference of the beams, excitation, ceiling, spectra."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from atpid_control.analysis.rows import shown_unit
from atpid_control.views.report.panels import extremes
from atpid_lab.comparison.compare import Compared, RunOnAxis
from atpid_sim.figure_style import LIGHT, Panels

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
