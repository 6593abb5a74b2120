# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page's charts as plain plotly figures. Colours are names ("@own") that the page fills in for light and dark."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from atpid_control.analysis.analyse import Analysis
from atpid_control.views.report.panels import Chart, Panel, anchor, extremes
from atpid_sim.system import Array

Figure = dict[str, Any]

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
    figure["layout"]["shapes"] = [
        {"type": "rect", "xref": "x", "yref": "paper", "x0": begin, "x1": end, "y0": 0, "y1": 1, "layer": "below",
         "line": {"width": 0}, "fillcolor": "@window"}
        for begin, end in chart.windows
    ]  # fmt: skip
    return figure


def spectra(found: Analysis, modes: Sequence[float] = ()) -> Figure:
    """Return the power spectral densities of drive and beam, with the frequencies (k,) [Hz] of a structure's modes.

    They go to eight times the frequency of half the beam's power, or beyond the last mode.
    """
    figure: Figure = {"data": [], "layout": _layout(320)}
    beam = found.spectra[1]
    total = np.cumsum(beam.density[1:])
    marked = [mode for mode in modes if mode < beam.frequency[-1]]
    end = max(
        8 * (int(np.searchsorted(total, 0.5 * total[-1])) + 1), round(1.1 * max(marked, default=0.0) / beam.resolution)
    )
    top = float(np.log10(max(float(one.density[1:].max()) for one in found.spectra)))
    names = ("force" if found.spectra[0].unit == "N" else "support", "beam")
    for one, name, colour in zip(found.spectra, names, ("@given", "@own"), strict=True):
        chosen = slice(1, end + 1)
        density = np.where(one.density[chosen] > 0.0, one.density[chosen], np.nan)
        x, y = [round(float(f), 4) for f in one.frequency[chosen]], [float(f"{v:.4g}") for v in density]
        shown = [value if np.isfinite(value) else None for value in y]
        line = {"color": colour, "width": 1.6}
        figure["data"].append({"type": "scatter", "mode": "lines", "x": x, "y": shown, "name": name, "line": line,
                               "hovertemplate": f"%{{y:.3g}} {one.unit}²/Hz"})  # fmt: skip
    figure["layout"]["showlegend"] = True
    figure["layout"]["legend"] = {"x": 1, "xanchor": "right", "y": 1}
    figure["layout"]["xaxis"] = {**_axis(), "title": {"text": "frequency, Hz"}}
    figure["layout"]["yaxis"] = {**_axis(), "type": "log", "range": [top - 10.0, top + 0.5], "exponentformat": "power"}
    figure["layout"]["shapes"] = [
        {"type": "line", "xref": "x", "yref": "paper", "x0": mode, "x1": mode, "y0": 0, "y1": 1, "layer": "below",
         "line": {"width": 1, "color": "@accent", "dash": "dot"}}
        for mode in marked
    ]  # fmt: skip
    for number, mode in enumerate(marked, 1):
        _note(figure, name="mode", xref="x", yref="paper", x=mode, y=1, xanchor="left", yanchor="top", xshift=3,
              text=f"mode {number}", font={"color": "@accent"})  # fmt: skip
    _title(
        figure, 1.0, "Power spectral density", " and ".join(dict.fromkeys(f"{one.unit}²/Hz" for one in found.spectra))
    )
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
        own = {"mode": "markers", "marker": {"color": f"@{curve.colour}", "size": 8, "symbol": symbol}}
        line = {"mode": "lines", "line": {"color": f"@{curve.colour}", "width": 1.4, "dash": dash}}
        figure["data"].append({
            "type": "scatter", "name": curve.name, "x": list(curve.x), "y": list(curve.y),
            "customdata": list(curve.pages), "showlegend": curve.marked,
            "error_y": {"type": "data", "array": list(curve.bars), "color": f"@{curve.colour}", "thickness": 1.2},
            "hovertemplate": f"%{{y:.4~g}} {unit}", **(own if curve.marked else line),
        })  # fmt: skip
    every = [x for curve in curves for x in curve.x]
    aside = 0.04 * (max(every) - min(every))
    figure["layout"] |= {
        "showlegend": True,
        "legend": {"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom"},
        "hovermode": "closest",
    }
    figure["layout"]["margin"] |= {"r": 20, "b": 80 + legend}
    limits = [min(every) - aside, max(every) + aside]
    figure["layout"]["xaxis"] = {**_axis(), "title": {"text": axis}, "range": limits}
    figure["layout"]["yaxis"] = {**_axis(), "rangemode": "tozero"}
    _title(figure, 1.0, title, unit)
    return figure


def _layout(height: int) -> Figure:
    return {
        "height": height, "margin": {"l": 56, "r": 112, "t": 34, "b": 44}, "showlegend": False, "annotations": [],
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)", "hovermode": "x unified",
        "font": {"family": _FONT, "size": 12.5, "color": "@muted"}, "dragmode": "zoom",
        "hoverlabel": {"bgcolor": "@paper", "bordercolor": "@grid", "font": {"color": "@ink"}},
    }  # fmt: skip


def _axis() -> Figure:
    return {"gridcolor": "@grid", "zerolinecolor": "@grid", "zerolinewidth": 1, "linecolor": "@grid", "ticks": ""}


def _note(figure: Figure, **given: Any) -> None:
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
        figure["data"].append(
            {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": curve.name, "yaxis": axis, "line": line,
             "hovertemplate": hover, "connectgaps": False}
        )  # fmt: skip
        _note(
            figure, name="label", xref="paper", yref=axis, x=1, y=curve.label, xanchor="left", xshift=8,
            yshift=8.0 * curve.side, text=f"<b>{curve.name}</b>", font={"color": f"@{curve.label_colour}"},
        )  # fmt: skip
    for middle, height, text in panel.efficiencies:
        place = {"xref": "x", "yref": axis, "x": middle, "y": height, "xanchor": anchor(middle / end), "yanchor": "top"}
        _note(figure, name="efficiency", text=f"<b>{text}</b>", font={"color": "@own", "size": 19}, **place)
    for middle, height, text in panel.printed:
        figure["data"].append(
            {"type": "scatter", "mode": "markers", "x": [middle], "y": [height], "yaxis": axis, "name": "thesis",
             "hoverinfo": "skip",
             "marker": {"symbol": "diamond", "size": 9, "color": "@accent", "line": {"color": "@paper", "width": 1}}}
        )  # fmt: skip
        place = {"xref": "x", "yref": axis, "x": middle, "y": height, "xanchor": anchor(middle / end), "yanchor": "top"}
        _note(figure, name="printed", text=text, font={"color": "@accent"}, yshift=-5, **place)
    scale = figure["layout"][f"yaxis{axis[1:]}"]
    scale |= {"rangemode": "tozero"} if panel.limits[0] == 0.0 else {"range": list(panel.limits)}
    if panel.errors is not None:
        chosen = extremes(panel.errors[1], _POINTS)
        time, error, bar = ([round(float(value), 5) for value in values[chosen]] for values in panel.errors)
        scale["tickvals"] = [panel.limits[0], 0.0, panel.limits[1]]
        figure["data"].append(
            {"type": "scatter", "mode": "markers", "x": time, "yaxis": axis, "name": "error", "y": error,
             "marker": {"color": "@own", "size": 3.5}, "hovertemplate": hover,
             "error_y": {"type": "data", "array": bar, "color": "@soft", "thickness": 2.0, "width": 0}}
        )  # fmt: skip
