# SPDX-License-Identifier: Apache-2.0
"""The page's charts as plain plotly figures. Colours are names ("@own") that the page fills in for light and dark."""

from typing import Any

import numpy as np

from atpid_control.analysis.analyse import Analysis
from atpid_control.report.picture import apart, beam_title, estimate_errors, grain_lines, moved, rounded_up
from atpid_control.report.thinning import extremes
from atpid_control.report.view import View
from atpid_sim.system import Array

Figure = dict[str, Any]

#: Points a curve is drawn with at most: each bucket keeps its highest and lowest.
_POINTS = 6000
_FONT = "Inter, system-ui, -apple-system, Segoe UI, Roboto, Helvetica, Arial, sans-serif"
_GAP = 0.07


def thinned(time: Array, value: Array, points: int = _POINTS) -> tuple[list[float], list[float | None]]:
    """Return a curve with at most `points` points that keeps every extreme; NaN as None."""
    chosen = extremes(value, points)
    time, value = time[chosen], value[chosen]
    return [round(float(t), 5) for t in time], [round(float(v), 7) if np.isfinite(v) else None for v in value]


def overview(view: View) -> Figure:
    """Return the panels over the run's time, one time axis for all."""
    panels = [(_beam, 3.4)]
    panels += [(_excitation, 1.4), (_error, 1.0)] if view.stages else []
    panels += [(_ceiling, 1.6)] if view.moving else []
    total = sum(share for _, share in panels)
    room = 1.0 - _GAP * (len(panels) - 1)
    figure: Figure = {"data": [], "layout": _layout(800 if view.stages else 520)}
    top = 1.0
    for number, (draw, share) in enumerate(panels, start=1):
        bottom = max(0.0, top - room * share / total)
        axis = "" if number == 1 else str(number)
        figure["layout"][f"yaxis{axis}"] = {**_axis(), "domain": [bottom, top]}
        draw(figure, view, f"y{axis}", top)
        top = bottom - _GAP
    last = "y" + (str(len(panels)) if len(panels) > 1 else "")
    time = {"range": [0.0, view.run.duration], "title": {"text": "time, s"}, "minallowed": 0.0}
    figure["layout"]["xaxis"] = {**_axis(), "anchor": last, **time}
    figure["layout"]["shapes"] = [
        {"type": "rect", "xref": "x", "yref": "paper", "x0": begin, "x1": end, "y0": 0, "y1": 1, "layer": "below",
         "line": {"width": 0}, "fillcolor": "@window"}
        for begin, end in view.windows
    ]  # fmt: skip
    return figure


def grain(view: View) -> Figure | None:
    """Return the grain between floor and ceiling over the last periods; None where its position is unknown."""
    if view.grain_window is None:
        return None
    begin, until = view.grain_window
    time = view.run.motion.time
    inside = (time >= begin) & (time <= until)
    figure: Figure = {"data": [], "layout": _layout(360)}
    figure["layout"]["xaxis"] = {**_axis(), "range": [begin, until], "title": {"text": "time, s"}}
    figure["layout"]["yaxis"] = _axis()
    floor, ceiling, ball = (line[inside] for line in grain_lines(view))
    lines, reach = (floor, ball, ceiling), float(ceiling.max() - floor.min())
    ends = apart([float(line[-1]) for line in lines], 0.07 * reach)
    names = (("floor", "@given_text", 1.6), ("grain", "@own", 2.4), ("ceiling", "@given_text", 1.6))
    for (name, colour, width), line, end in zip(names, lines, ends, strict=True):
        _line(figure, "y", time[inside], line, name, colour, width, "%{y:.4f} m")
        _label(figure, "y", end, name, colour)
    _title(figure, 1.0, "The grain between floor and ceiling", "m")
    return figure


def spectra(found: Analysis) -> Figure:
    """Return the power spectral densities of support and beam, to eight times the frequency of half the power."""
    figure: Figure = {"data": [], "layout": _layout(320)}
    beam = found.spectra[1]
    total = np.cumsum(beam.density[1:])
    end = 8 * (int(np.searchsorted(total, 0.5 * total[-1])) + 1)
    top = float(np.log10(max(float(one.density[1:].max()) for one in found.spectra)))
    for one, name, colour in zip(found.spectra, ("support", "beam"), ("@given", "@own"), strict=True):
        chosen = slice(1, end + 1)
        density = np.where(one.density[chosen] > 0.0, one.density[chosen], np.nan)
        x, y = [round(float(f), 4) for f in one.frequency[chosen]], [float(f"{v:.4g}") for v in density]
        shown = [value if np.isfinite(value) else None for value in y]
        line = {"color": colour, "width": 1.6}
        figure["data"].append({"type": "scatter", "mode": "lines", "x": x, "y": shown, "name": name, "line": line,
                               "hovertemplate": "%{y:.3g} m²/Hz"})  # fmt: skip
    figure["layout"]["showlegend"] = True
    figure["layout"]["legend"] = {"x": 1, "xanchor": "right", "y": 1}
    figure["layout"]["xaxis"] = {**_axis(), "title": {"text": "frequency, Hz"}}
    figure["layout"]["yaxis"] = {**_axis(), "type": "log", "range": [top - 10.0, top + 0.5], "exponentformat": "power"}
    _title(figure, 1.0, "Power spectral density", "m²/Hz")
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


def _line(
    figure: Figure, axis: str, time: Array, value: Array, name: str, colour: str, width: float, hover: str,
    **more: Any,
) -> None:  # fmt: skip
    x, y = thinned(time, value)
    style = {"color": colour, "width": width, **more}
    figure["data"].append(
        {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "yaxis": axis, "line": style,
         "hovertemplate": hover, "connectgaps": False}
    )  # fmt: skip


def _note(figure: Figure, **given: Any) -> None:
    figure["layout"]["annotations"].append({"showarrow": False, **given})


def _title(figure: Figure, top: float, text: str, unit: str) -> None:
    place = {"xref": "paper", "yref": "paper", "x": 0, "y": top, "yanchor": "bottom", "yshift": 5}
    _note(figure, **place, xanchor="left", text=f"<b>{text}</b>", font={"color": "@ink", "size": 13.5})
    _note(figure, **place, xanchor="right", xshift=-6, text=unit)


def _label(figure: Figure, axis: str, height: float, text: str, colour: str, shift: float = 0.0) -> None:
    _note(
        figure, name="label", xref="paper", yref=axis, x=1, y=height, xanchor="left", xshift=8, yshift=shift,
        text=f"<b>{text}</b>", font={"color": colour},
    )  # fmt: skip


def _beam(figure: Figure, view: View, axis: str, top: float) -> None:
    time, alone = view.run.motion.time, view.always_closed or view.closed is None
    _title(figure, top, beam_title(view, alone), "m")
    if view.closed is not None and not alone:
        _line(figure, axis, time, view.closed, "closed", "@given", 1.0, "%{y:.4f} m")
    _line(figure, axis, time, view.beam, view.own_name, "@own", 1.1, "%{y:.4f} m")
    reach = view.reach
    figure["layout"]["yaxis"]["range"] = [-1.08 * reach, (1.34 if view.stages else 1.08) * reach]
    late = time > 0.9 * time[-1]
    own = float(np.nanmax(view.beam[late]))
    if view.closed is not None and not alone:
        _label(figure, axis, max(float(np.nanmax(view.closed[late])), own + 0.16 * reach), "closed", "@given_text")
    _label(figure, axis, 0.0 if alone else 0.5 * own, view.own_name, "@own")
    for stage, (begin, end) in zip(view.stages, view.windows, strict=True):
        if not alone and np.isfinite(stage.efficiency):
            place = {"xref": "x", "yref": axis, "x": 0.5 * (begin + end), "y": 1.3 * reach, "yanchor": "top"}
            text, font = f"<b>{stage.efficiency_text()}</b>", {"color": "@own", "size": 19}
            _note(figure, name="efficiency", text=text, font=font, **place)


def _excitation(figure: Figure, view: View, axis: str, top: float) -> None:
    _title(figure, top, "Support amplitude", "mm")
    estimates = view.run.estimates
    if view.true_amplitude is not None:
        _line(figure, axis, view.run.motion.time, 1e3 * view.true_amplitude, "true", "@given", 4.5, "%{y:.3f} mm")
        _label(figure, axis, 1e3 * float(view.true_amplitude[-1]), "true", "@given_text", 8.0)
    if estimates.steady.any():
        _line(figure, axis, estimates.time, 1e3 * estimates.amplitude, "identified", "@own", 1.8, "%{y:.3f} mm")
        _label(figure, axis, 1e3 * float(estimates.amplitude[estimates.steady][-1]), "identified", "@own", -8.0)
    figure["layout"][f"yaxis{axis[1:]}"]["rangemode"] = "tozero"


def _error(figure: Figure, view: View, axis: str, top: float) -> None:
    _title(figure, top, "Error of the identified amplitude, ±2σ", "%")
    found = estimate_errors(view)
    if found is None:
        return
    time, error, width = found
    limit = rounded_up(float(np.nanmax(np.abs(error) + width)))
    chosen = extremes(error, _POINTS)
    time, error, width = time[chosen], error[chosen], width[chosen]
    figure["layout"][f"yaxis{axis[1:]}"] |= {"range": [-limit, limit], "tickvals": [-limit, 0.0, limit]}
    figure["data"].append(
        {"type": "scatter", "mode": "markers", "x": [round(float(t), 5) for t in time], "yaxis": axis, "name": "error",
         "y": [round(float(e), 5) for e in error], "marker": {"color": "@own", "size": 3.5},
         "error_y": {"type": "data", "array": [round(float(w), 5) for w in width], "color": "@soft", "thickness": 2.0,
                     "width": 0}, "hovertemplate": "%{y:.3f} %"}
    )  # fmt: skip


def _ceiling(figure: Figure, view: View, axis: str, top: float) -> None:
    _title(figure, top, "Ceiling height", "m")
    ceiling = view.run.ceiling
    sent = np.isfinite(ceiling.commanded)
    if sent.any() and view.own_name == "adaptive":
        _line(figure, axis, ceiling.commanded_time[sent], ceiling.commanded[sent], "commanded", "@given", 4.5,
              "%{y:.4f} m", shape="hv")  # fmt: skip
        _label(figure, axis, float(ceiling.commanded[sent][-1]), "commanded", "@given_text", 8.0)
    time, height = moved(view)
    if len(height):
        _line(figure, axis, time, height, "moved", "@own", 1.8, "%{y:.4f} m")
        _label(figure, axis, float(height[-1]), "moved", "@own", -8.0 if view.own_name == "adaptive" else 0.0)
    for printed, (begin, end) in zip(view.printed or [], view.windows, strict=False):
        figure["data"].append(
            {"type": "scatter", "mode": "markers+text", "x": [0.5 * (begin + end)], "y": [printed.height],
             "text": [f"thesis {printed.height_sign}{printed.height:.2g}"], "textposition": "bottom center",
             "textfont": {"color": "@accent"}, "yaxis": axis, "name": "thesis", "hoverinfo": "skip",
             "marker": {"symbol": "diamond", "size": 9, "color": "@accent", "line": {"color": "@paper", "width": 1}}}
        )  # fmt: skip
    figure["layout"][f"yaxis{axis[1:]}"]["rangemode"] = "tozero"
