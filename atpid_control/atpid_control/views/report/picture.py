# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pictures as PNG, for README and papers; the page draws the same panels."""

from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from atpid_common.files import Document
from atpid_control.views.report.panels import Chart, Curve, Panel, anchor, extremes, grain, overview
from atpid_control.views.report.view import View
from atpid_sim.figure_style import DARK, LIGHT, SIZE, Palette, metadata_of, style

_DPI = 160
#: The compression that takes half the time of the default one, for a fifth more bytes.
_PNG = {"compress_level": 3}
#: A curve longer than this is drawn with so many of its points.
_LONG, _POINTS = 200_000, 20_000


def save_pictures(view: View, folder: Path) -> None:
    """Draw every picture the run has, light and dark."""
    for scheme, palette in (("", LIGHT), ("-dark", DARK)):
        for name, chart in (("overview", overview(view)), ("grain", grain(view))):
            if chart is not None:
                figure = draw(chart, palette)
                figure.savefig(folder / f"{name}{scheme}.png", dpi=_DPI, metadata=metadata_of(figure), pil_kwargs=_PNG)


def draw(chart: Chart, palette: Palette) -> Figure:
    """Draw the panels below each other; a chart that begins later than at 0 counts its time from there."""
    with matplotlib.rc_context(style(palette)):
        panels = chart.panels
        height = 1.0 + 1.15 * sum(panel.share for panel in panels)
        figure = Figure(figsize=(11.0, height))
        edges: Document = {"left": 0.065, "right": 0.895, "top": 1.0 - 0.38 / height, "bottom": 0.55 / height}
        shares, gap = [panel.share for panel in panels], 0.42 if len(panels) > 2 else 0.3
        grid = figure.add_gridspec(len(panels), height_ratios=shares, hspace=gap, **edges)
        first = None
        for row, panel in enumerate(panels):
            axes = figure.add_subplot(grid[row], sharex=first)
            first = first or axes
            axes.set_xlim(0.0, chart.end - chart.begin)
            axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
            axes.tick_params(labelbottom=row == len(panels) - 1)
            for begin, end in chart.windows:
                axes.axvspan(begin, end, color=palette.window, lw=0.0, zorder=0)
            _panel(axes, panel, chart.begin, palette)
        axes.set_xlabel(f"time since {chart.begin:.2f} s, s" if chart.begin else "time, s")
    return figure


def _panel(axes: Axes, panel: Panel, start: float, palette: Palette) -> None:
    axes.set_title(panel.title, pad=7)
    place: Document = {"xytext": (-4, 7), "xycoords": "axes fraction", "ha": "right", "va": "bottom"}
    axes.annotate(panel.unit, (0.0, 1.0), textcoords="offset points", color=palette.muted, **place)
    for curve in panel.curves:
        _curve(axes, curve, start, palette)
    if panel.errors is not None:
        chosen = extremes(panel.errors[1], _POINTS)
        time, error, bar = (values[chosen] for values in panel.errors)
        axes.vlines(time, error - bar, error + bar, color=palette.soft, lw=1.8)
        axes.plot(time, error, ".", color=palette.own, ms=3.0, mew=0.0)
        axes.axhline(0.0, color=palette.given, lw=0.8, zorder=1)
        axes.set_yticks([panel.limits[0], 0.0, panel.limits[1]])
    end = axes.get_xlim()[1]
    for middle, height, text in panel.efficiencies:
        large: Document = {"fontsize": SIZE + 5.5, "fontweight": "bold"}
        axes.text(middle, height, text, ha=anchor(middle / end), va="top", color=palette.own, **large)
    for middle, height, text in panel.heights:
        axes.text(middle, height, text, ha=anchor(middle / end), va="bottom", color=palette.own)
    for middle, height, text in panel.printed:
        axes.plot(middle, height, "D", color=palette.accent, ms=4.5, mec=palette.paper, mew=0.8, zorder=5)
        below: Document = {"xytext": (0, -7), "ha": anchor(middle / end), "va": "top"}
        axes.annotate(text, (middle, height), textcoords="offset points", color=palette.accent, **below)
    axes.set_ylim(*panel.limits)
    if panel.walls:
        for curve, outside in zip((panel.curves[0], panel.curves[-1]), panel.limits, strict=True):
            axes.fill_between(curve.time - start, curve.value, outside, color=palette.window, lw=0.0)


def _curve(axes: Axes, curve: Curve, start: float, palette: Palette) -> None:
    """Draw a curve and its name; of a run of hours only its extremes: matplotlib needs 100 bytes a point and more."""
    chosen = extremes(curve.value, _POINTS) if len(curve.value) > _LONG else slice(None)
    time, value = curve.time[chosen] - start, curve.value[chosen]
    if curve.band is not None:
        band = curve.band[chosen]
        axes.fill_between(time, value - band, value + band, color=palette.soft, lw=0.0)
    look = {"color": getattr(palette, curve.colour), "lw": curve.widths[0]}
    axes.plot(time, value, drawstyle="steps-post" if curve.holds else "default", **look)
    place: Document = {"xytext": (7, 7.0 * curve.side), "xycoords": ("axes fraction", "data"), "va": "center"}
    bold: Document = {"color": getattr(palette, curve.label_colour), "fontweight": "bold", "annotation_clip": False}
    axes.annotate(curve.name, (1.0, curve.label), textcoords="offset points", **place, **bold)
