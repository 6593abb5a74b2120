# SPDX-License-Identifier: Apache-2.0
"""The picture of a design: six panels from the choice of the grain to the force on the ceiling."""

from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from atpid_control.design.make import Design
from atpid_control.report.picture import Palette, style


def draw(made: Design, palette: Palette) -> Figure:
    """Draw a design in the colours of a palette."""
    with matplotlib.rc_context(style(palette)):
        figure = Figure(figsize=(11.0, 10.4), layout="constrained")
        panels = figure.subplots(3, 2).flat
        drawers = (_grains, _efficiency, _heights, _cliff, _beam, _force)
        for axes, drawer in zip(panels, drawers, strict=True):
            drawer(axes, made, palette)
    return figure


def _title(axes: Any, text: str, x: str, y: str) -> None:
    axes.set_title(text, loc="left", fontsize=10.5, fontweight="bold")
    axes.set(xlabel=x, ylabel=y)


def _legend(axes: Any, where: str) -> None:
    paper = axes.get_facecolor()
    axes.legend(fontsize=8, loc=where, facecolor=paper, edgecolor=paper, framealpha=0.9)


def _band(
    axes: Any, x: Any, intervals: Any, palette: Palette, scale: float, name: str, band: str = "all cases"
) -> None:
    expected, low, high = scale * np.array(intervals).T
    axes.fill_between(x, low, high, color=palette.soft, lw=0.0, label=band)
    axes.plot(x, low, color=palette.own, lw=0.8)
    axes.plot(x, high, color=palette.own, lw=0.8)
    axes.plot(x, expected, "o-", color=palette.own, ms=4.0, lw=1.8, label=name)


def _millimetres(made: Design) -> Any:
    return np.array([1e3 * one.amplitude for one in made.points])


def _grains(axes: Any, made: Design, palette: Palette) -> None:
    sound = [one for one in made.candidates if not one.failure]
    x = np.array([1e3 * one.grain_mass for one in sound])
    expected, low, high = 100.0 * np.array([one.efficiency for one in sound]).T
    unit, scale = ("kg", 1e-3) if x.max() > 1e3 else ("g", 1.0)
    axes.vlines(scale * x, low, high, color=palette.soft, lw=6.0)
    axes.plot(scale * x, low, color=palette.own, lw=1.2, label="least, over amplitudes and corners")
    axes.plot(scale * x, expected, "o", color=palette.own, ms=4.0, label="least expected")
    axes.axvline(1e3 * scale * made.grain_mass, color=palette.accent, lw=1.2, label=f"chosen: {_mass(made)}")
    if made.problem.target_reduction is not None:
        axes.axhline(100.0 * made.problem.target_reduction, color=palette.accent, ls="--", lw=1.0, label="target")
    _title(axes, "The grain: what each mass keeps", f"mass of the grain [{unit}]", "efficiency [%]")
    axes.set_ylim(min(low.min(), 100.0 * made.efficiency[0]) - 3.0, 100.0)
    axes.set_xlim(0.0, None)
    _legend(axes, "lower right")


def _mass(made: Design) -> str:
    grams = 1e3 * made.grain_mass
    return f"{made.grain_mass:.3g} kg" if grams >= 1e3 else f"{grams:.3g} g"


def _efficiency(axes: Any, made: Design, palette: Palette) -> None:
    _band(axes, _millimetres(made), [p.efficiency for p in made.points], palette, 100.0, "expected")
    bare = [100.0 * p.best_efficiency for p in made.points]
    axes.plot(_millimetres(made), bare, color=palette.given, lw=1.2, ls="--", label="bare optimum")
    _title(axes, "Reduction at the design height", "support amplitude [mm]", "efficiency [%]")
    _legend(axes, "lower right")


def _heights(axes: Any, made: Design, palette: Palette) -> None:
    x = _millimetres(made)
    best = [1e3 * p.best_height for p in made.points]
    axes.plot(x, best, color=palette.given, lw=1.2, ls="--", label="bare optimum")
    axes.plot(x, [1e3 * p.height for p in made.points], "o-", color=palette.own, ms=4.0, lw=1.8, label="design")
    axes.axhline(2e3 * made.radius, color=palette.given, lw=1.2, label="closed: the grain's diameter")
    _title(axes, "Height of the ceiling", "support amplitude [mm]", "mm")
    axes.set_ylim(0.0, None)
    _legend(axes, "lower right")


def _cliff(axes: Any, made: Design, palette: Palette) -> None:
    found = made.landscape
    heights = 1e3 * found.heights
    axes.plot(heights, 100.0 * found.cases, color=palette.given, lw=0.7)
    axes.plot([], [], color=palette.given, lw=0.7, label="corners of the box")
    axes.plot(heights, 100.0 * found.given, color=palette.own, lw=1.8, label="given structure")
    (point,) = [one for one in made.points if one.amplitude == found.amplitude]
    axes.axvline(1e3 * point.height, color=palette.accent, lw=1.2, label=f"design: {1e3 * point.height:.1f} mm")
    title = f"What is left over the height, at {1e3 * found.amplitude:.3g} mm"
    _title(axes, title, "height of the ceiling [mm]", "beam's amplitude over closed damper's [%]")
    axes.set_ylim(0.0, min(100.0, 125.0 * float(np.nanmax(found.cases))))
    _legend(axes, "upper right")


def _beam(axes: Any, made: Design, palette: Palette) -> None:
    x = _millimetres(made)
    axes.plot(x, [1e3 * p.closed_amplitude for p in made.points], color=palette.given_text, lw=1.4,
              label="damper closed")  # fmt: skip
    _band(axes, x, [p.beam_amplitude for p in made.points], palette, 1e3, "with the damper")
    _title(axes, "Amplitude of the structure", "support amplitude [mm]", "mm")
    axes.set_yscale("log")
    for formatted in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        formatted(FuncFormatter(_one_two_five))
    _legend(axes, "upper left")


def _one_two_five(value: float, _: int) -> str:
    """Return the label of a logarithmic axis at 1, 2 and 5 in each decade; others stay without."""
    return f"{value:g}" if f"{value:e}"[0] in "125" else ""


def _force(axes: Any, made: Design, palette: Palette) -> None:
    _band(axes, _millimetres(made), [p.ceiling_force for p in made.points], palette, 1.0, "expected", "corners")
    axes.axhline(made.motor.force, color=palette.accent, lw=1.2, label=f"the ceiling bears {made.motor.force:.4g} N")
    _title(axes, "Largest contact force on the ceiling", "support amplitude [mm]", "N")
    axes.set_ylim(0.0, None)
    _legend(axes, "lower right")
