# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page's charts as plain plotly figures. Colours are names ("@own") that the page fills in for light and dark."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from atpid_common.files import Document
from atpid_control.analysis.analyse import Analysis
from atpid_control.views.report.panels import Chart, Panel, anchor, extremes
from atpid_sim.system import Array

#: A figure as plotly reads it from JSON.
Figure = Document

#: Points a curve is drawn with at most: each bucket keeps its highest and lowest.
_POINTS = 6000
_FONT = "Inter, system-ui, -apple-system, Segoe UI, Roboto, Helvetica, Arial, sans-serif"
#: Marks and lines of curves that share a colour.
_LOOKS = (("circle-open", "solid"), ("square-open", "dash"), ("diamond-open", "dot"))
#: Between two panels, and above and below all of them [px].
_GAP, _AROUND = 52, 78


def thinned(time: Array, value: Array, points: int = _POINTS) -> tuple[list[float], list[float | None]]:
    """Return a curve with at most `points` points that keeps every extreme; NaN as None."""
    chosen = extremes(value, points)
    time, value = time[chosen], value[chosen]
    return [round(float(t), 5) for t in time], [round(float(v), 7) if np.isfinite(v) else None for v in value]


def draw(chart: Chart) -> Figure:
    """Return the panels below each other, one time axis for all."""
    total = sum(panel.share for panel in chart.panels)
    gap = _GAP / (chart.height - _AROUND)
    room = 1.0 - gap * (len(chart.panels) - 1)
    figure: Figure = {"data": [], "layout": _layout(chart.height)}
    top = 1.0
    for number, panel in enumerate(chart.panels, start=1):
        bottom = max(0.0, top - room * panel.share / total)
        axis = "y" if number == 1 else f"y{number}"
        figure["layout"][f"yaxis{axis[1:]}"] = {**_axis(), "domain": [bottom, top]}
        _panel(figure, panel, axis, top, chart.end)
        top = bottom - gap
    time = {"range": [chart.begin, chart.end], "title": {"text": "time, s"}, "minallowed": 0.0}
    figure["layout"]["xaxis"] = {**_axis(), "anchor": axis, **time}
    window = {"type": "rect", "line": {"width": 0}, "fillcolor": "@window"}
    figure["layout"]["shapes"] = [window | _span(begin, end) for begin, end in chart.windows]
    return figure


def spectra(found: Analysis, modes: Sequence[float] = ()) -> Figure:
    """Return the power spectral densities of drive and beam, with the frequencies (k,) [Hz] of a structure's modes.

    They go to eight times the frequency of half the beam's power, or beyond the last mode.
    """
    figure: Figure = {"data": [], "layout": _layout(320)}
    beam = found.spectra[1]
    total = np.cumsum(beam.density[1:])
    marked = [mode for mode in modes if mode < beam.frequency[-1]]
    half = int(np.searchsorted(total, 0.5 * total[-1])) + 1
    end = max(8 * half, round(1.1 * max(marked, default=0.0) / beam.resolution))
    top = float(np.log10(max(float(one.density[1:].max()) for one in found.spectra)))
    names = ("force" if found.spectra[0].unit == "N" else "support", "beam")
    for one, name, colour in zip(found.spectra, names, ("@given", "@own"), strict=True):
        chosen = slice(1, end + 1)
        density = np.where(one.density[chosen] > 0.0, one.density[chosen], np.nan)
        x, y = [round(float(f), 4) for f in one.frequency[chosen]], [float(f"{v:.4g}") for v in density]
        shown = [value if np.isfinite(value) else None for value in y]
        hover = f"%{{y:.3g}} {one.unit}²/Hz"
        _scatter(figure, "lines", x, shown, name=name, line={"color": colour, "width": 1.6}, hovertemplate=hover)
    figure["layout"]["showlegend"] = True
    figure["layout"]["legend"] = {"x": 1, "xanchor": "right", "y": 1}
    figure["layout"]["xaxis"] = {**_axis(), "title": {"text": "frequency, Hz"}}
    figure["layout"]["yaxis"] = {**_axis(), "type": "log", "range": [top - 10.0, top + 0.5], "exponentformat": "power"}
    dotted = {"type": "line", "line": {"width": 1, "color": "@accent", "dash": "dot"}}
    figure["layout"]["shapes"] = [dotted | _span(mode, mode) for mode in marked]
    place = {"xref": "x", "yref": "paper", "y": 1, "xanchor": "left", "yanchor": "top", "xshift": 3}
    for number, mode in enumerate(marked, 1):
        _note(figure, **place, name="mode", x=mode, text=f"mode {number}", font={"color": "@accent"})
    units = dict.fromkeys(f"{one.unit}²/Hz" for one in found.spectra)
    _title(figure, 1.0, "Power spectral density", " and ".join(units))
    return figure


@dataclass(frozen=True)
class Marked:
    """A curve through points (n,) with error bars: measured ones are marked, simulated ones joined."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    bars: Sequence[float]
    colour: str
    marked: bool
    pages: Sequence[str] = ()  # address of each point's own page
    cycle: int = 0  # how many curves before it have its colour


def points(title: str, unit: str, axis: str, curves: Sequence[Marked]) -> Figure:
    """Return curves over a quantity in one panel, with a legend below it."""
    legend = 4 * sum(curve.marked for curve in curves)  # [px], about five names in a row
    figure: Figure = {"data": [], "layout": _layout(380 + legend)}
    for curve in curves:
        symbol, dash = _LOOKS[curve.cycle % len(_LOOKS)]
        colour = f"@{curve.colour}"
        marks = {"marker": {"color": colour, "size": 8, "symbol": symbol}}
        look = marks if curve.marked else {"line": {"color": colour, "width": 1.4, "dash": dash}}
        look["error_y"] = {"type": "data", "array": list(curve.bars), "color": colour, "thickness": 1.2}
        mode, x, y = "markers" if curve.marked else "lines", list(curve.x), list(curve.y)
        about = {"name": curve.name, "customdata": list(curve.pages), "showlegend": curve.marked}
        _scatter(figure, mode, x, y, hovertemplate=f"%{{y:.4~g}} {unit}", **about, **look)
    every = [x for curve in curves for x in curve.x]
    aside = 0.04 * (max(every) - min(every))
    below = {"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom"}
    figure["layout"] |= {"showlegend": True, "legend": below, "hovermode": "closest"}
    figure["layout"]["margin"] |= {"r": 20, "b": 80 + legend}
    limits = [min(every) - aside, max(every) + aside]
    figure["layout"]["xaxis"] = {**_axis(), "title": {"text": axis}, "range": limits}
    figure["layout"]["yaxis"] = {**_axis(), "rangemode": "tozero"}
    _title(figure, 1.0, title, unit)
    return figure


def _layout(height: int) -> Figure:
    margin, font = {"l": 56, "r": 112, "t": 34, "b": 44}, {"family": _FONT, "size": 12.5, "color": "@muted"}
    label = {"bgcolor": "@paper", "bordercolor": "@grid", "font": {"color": "@ink"}}
    clear = dict.fromkeys(("paper_bgcolor", "plot_bgcolor"), "rgba(0,0,0,0)")
    mouse = {"hovermode": "x unified", "dragmode": "zoom", "hoverlabel": label}
    return {"height": height, "margin": margin, "font": font, "showlegend": False, "annotations": []} | clear | mouse


def _axis() -> Figure:
    return {"gridcolor": "@grid", "zerolinecolor": "@grid", "zerolinewidth": 1, "linecolor": "@grid", "ticks": ""}


def _span(begin: float, end: float) -> Figure:
    """Return where a shape is, behind the curves and over the whole height of the chart."""
    return {"xref": "x", "yref": "paper", "x0": begin, "x1": end, "y0": 0, "y1": 1, "layer": "below"}


def _scatter(figure: Figure, mode: str, x: Sequence[float], y: Sequence[float | None], **given: object) -> None:
    figure["data"].append({"type": "scatter", "mode": mode, "x": x, "y": y, **given})


def _note(figure: Figure, **given: object) -> None:
    figure["layout"]["annotations"].append({"showarrow": False, **given})


def _title(figure: Figure, top: float, text: str, unit: str) -> None:
    place = {"xref": "paper", "yref": "paper", "x": 0, "y": top, "yanchor": "bottom", "yshift": 5}
    _note(figure, **place, name="title", xanchor="left", text=f"<b>{text}</b>", font={"color": "@ink", "size": 13.5})
    _note(figure, **place, name="unit", xanchor="right", xshift=-6, text=unit)


def _panel(figure: Figure, panel: Panel, axis: str, top: float, end: float) -> None:
    _title(figure, top, panel.title, panel.unit)
    hover = f"%{{y:.4~g}} {panel.unit}"
    for curve in panel.curves:
        x, y = thinned(curve.time, curve.value)
        line = {"color": f"@{curve.colour}", "width": curve.widths[1]} | ({"shape": "hv"} if curve.holds else {})
        look = {"line": line, "hovertemplate": hover, "connectgaps": False}
        _scatter(figure, "lines", x, y, name=curve.name, yaxis=axis, **look)
        place = {"xref": "paper", "yref": axis, "x": 1, "y": curve.label, "xanchor": "left", "xshift": 8}
        font = {"color": f"@{curve.label_colour}"}
        _note(figure, **place, name="label", yshift=8.0 * curve.side, text=f"<b>{curve.name}</b>", font=font)
    at = {"xref": "x", "yref": axis, "yanchor": "top"}
    for middle, height, text in panel.efficiencies:
        place = {"x": middle, "y": height, "xanchor": anchor(middle / end)}
        _note(figure, **at, **place, name="efficiency", text=f"<b>{text}</b>", font={"color": "@own", "size": 19})
    mark = {"symbol": "diamond", "size": 9, "color": "@accent", "line": {"color": "@paper", "width": 1}}
    for middle, height, text in panel.printed:
        _scatter(figure, "markers", [middle], [height], name="thesis", yaxis=axis, hoverinfo="skip", marker=mark)
        place = {"x": middle, "y": height, "xanchor": anchor(middle / end), "yshift": -5}
        _note(figure, **at, **place, name="printed", text=text, font={"color": "@accent"})
    scale = figure["layout"][f"yaxis{axis[1:]}"]
    scale |= {"rangemode": "tozero"} if panel.limits[0] == 0.0 else {"range": list(panel.limits)}
    if panel.errors is not None:
        chosen = extremes(panel.errors[1], _POINTS)
        time, error, bar = ([round(float(value), 5) for value in values[chosen]] for values in panel.errors)
        scale["tickvals"] = [panel.limits[0], 0.0, panel.limits[1]]
        bars = {"type": "data", "array": bar, "color": "@soft", "thickness": 2.0, "width": 0}
        look = {"marker": {"color": "@own", "size": 3.5}, "hovertemplate": hover, "error_y": bars}
        _scatter(figure, "markers", time, error, name="error", yaxis=axis, **look)
