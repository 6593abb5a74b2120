# SPDX-License-Identifier: Apache-2.0
"""The picture of a design: eight panels from the choice of the grain to a tuned mass of the same weight."""

from collections.abc import Callable, Iterator
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from atpid_control.design.make import Design
from atpid_sim.figure_style import Palette, style


def draw(made: Design, palette: Palette) -> Figure:
    """Draw a design in the colours of a palette: all panels in one figure."""
    with matplotlib.rc_context(style(palette)):
        figure = Figure(figsize=(11.0, 15.0), layout="constrained")
        for axes, drawer in zip(figure.subplots(4, 2).flat, _drawers(), strict=True):
            drawer(axes, made, palette)
    return figure


def draw_each(made: Design, palette: Palette) -> Iterator[Figure]:
    """Yield a figure for each panel."""
    for drawer in _drawers():
        with matplotlib.rc_context(style(palette)):
            figure = Figure(figsize=(5.0, 3.6), layout="constrained")
            drawer(figure.subplots(), made, palette)
        yield figure


def _drawers() -> tuple[Callable[[Any, Design, Palette], None], ...]:
    return _beam, _reduction, _grains, _efficiency, _heights, _cliff, _force, _tuned_mass


def _title(axes: Any, text: str, x: str, y: str) -> None:
    axes.set(title=text, xlabel=x, ylabel=y)


def _legend(axes: Any) -> None:
    """Draw the legend below the axes, where it hides no curve."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)


def _band(
    axes: Any, x: Any, intervals: Any, palette: Palette, scale: float, name: str, band: str = "all cases"
) -> None:
    expected, low, high = scale * np.array(intervals).T
    axes.fill_between(x, low, high, color=palette.soft, lw=0.0, label=band)
    axes.plot(x, low, color=palette.own, lw=0.8)
    axes.plot(x, high, color=palette.own, lw=0.8)
    axes.plot(x, expected, "o-", color=palette.own, ms=4.0, lw=1.8, label=name)


def _levels(made: Design) -> Any:
    return np.array([made.problem.unit[0] * one.amplitude for one in made.points])


def _level_name(made: Design) -> str:
    return f"{made.problem.drive} amplitude [{made.problem.unit[1]}]"


def _grains(axes: Any, made: Design, palette: Palette) -> None:
    sound = [one for one in made.candidates if not one.failure]
    x = np.array([1e3 * one.grain_mass for one in sound])
    aim = made.problem.aim
    expected, low, high = 100.0 * np.array([getattr(one, aim) for one in sound]).T
    unit, scale = ("kg", 1e-3) if x.max() > 1e3 else ("g", 1.0)
    axes.vlines(scale * x, low, high, color=palette.soft, lw=6.0)
    axes.plot(scale * x, low, color=palette.own, lw=1.2, label="least, over amplitudes and corners")
    axes.plot(scale * x, expected, "o", color=palette.own, ms=4.0, label="least expected")
    axes.axvline(1e3 * scale * made.grain_mass, color=palette.accent, lw=1.2, label=f"chosen: {_mass(made)}")
    target = getattr(made.problem, f"target_{aim}")
    if target is not None:
        axes.axhline(100.0 * target, color=palette.accent, ls="--", lw=1.0, label="target")
    _title(axes, "The grain: what each mass keeps", f"mass of the grain [{unit}]", f"{aim} [%]")
    axes.set_ylim(min(low.min(), 100.0 * getattr(made, aim)[0], 0.0) - 3.0, 100.0)
    axes.set_xlim(0.0, None)
    _legend(axes)


def _mass(made: Design) -> str:
    grams = 1e3 * made.grain_mass
    return f"{made.grain_mass:.3g} kg" if grams >= 1e3 else f"{grams:.3g} g"


def _efficiency(axes: Any, made: Design, palette: Palette) -> None:
    _band(axes, _levels(made), [p.efficiency for p in made.points], palette, 100.0, "expected")
    bare = [100.0 * p.best_efficiency for p in made.points]
    axes.plot(_levels(made), bare, color=palette.given, lw=1.2, ls="--", label="bare optimum")
    _title(axes, "Efficiency: against the closed damper", _level_name(made), "efficiency [%]")
    _from_zero(axes)
    _legend(axes)


def _reduction(axes: Any, made: Design, palette: Palette) -> None:
    _band(axes, _levels(made), [p.reduction for p in made.points], palette, 100.0, "expected")
    axes.axhline(0.0, color=palette.accent, lw=1.2, label="as without the damper; below: worse")
    _title(axes, "Reduction: against the structure of today", _level_name(made), "reduction [%]")
    _from_zero(axes)
    _legend(axes)


def _from_zero(axes: Any) -> None:
    """Let an axis in per cent include 0 and 100."""
    axes.set_ylim(min(axes.get_ylim()[0], 0.0), 102.0)


def _heights(axes: Any, made: Design, palette: Palette) -> None:
    x = _levels(made)
    best = [1e3 * p.best_height for p in made.points]
    axes.plot(x, best, color=palette.given, lw=1.2, ls="--", label="bare optimum")
    axes.plot(x, [1e3 * p.height for p in made.points], "o-", color=palette.own, ms=4.0, lw=1.8, label="design")
    axes.axhline(2e3 * made.radius, color=palette.given, lw=1.2, label="closed: the grain's diameter")
    _title(axes, "Height of the ceiling", _level_name(made), "mm")
    axes.set_ylim(0.0, None)
    _legend(axes)


def _cliff(axes: Any, made: Design, palette: Palette) -> None:
    found = made.landscape
    heights = 1e3 * found.heights
    axes.plot(heights, 100.0 * found.cases, color=palette.given, lw=0.7)
    axes.plot([], [], color=palette.given, lw=0.7, label="corners of the box")
    axes.plot(heights, 100.0 * found.given, color=palette.own, lw=1.8, label="given structure")
    (point,) = [one for one in made.points if one.amplitude == found.amplitude]
    axes.axvline(1e3 * point.height, color=palette.accent, lw=1.2, label=f"design: {1e3 * point.height:.1f} mm")
    title = f"Amplitude over the height, at a {made.problem.drive} of {made.problem.level(found.amplitude)}"
    _title(axes, title, "height of the ceiling [mm]", "% of the closed damper's")
    axes.set_ylim(0.0, min(100.0, 125.0 * float(np.nanmax(found.cases))))
    _legend(axes)


def _beam(axes: Any, made: Design, palette: Palette) -> None:
    x = _levels(made)
    axes.plot(x, [1e3 * p.closed_amplitude for p in made.points], color=palette.given_text, lw=1.4,
              label="damper closed")  # fmt: skip
    axes.plot(x, [1e3 * p.bare_amplitude.expected for p in made.points], color=palette.accent, lw=1.4,
              label="today, without the damper")  # fmt: skip
    _band(axes, x, [p.beam_amplitude for p in made.points], palette, 1e3, "with the damper")
    _title(axes, "Amplitude of the structure", _level_name(made), "mm, logarithmic")
    _logarithmic(axes)
    _legend(axes)


def _logarithmic(axes: Any) -> None:
    axes.set_yscale("log")
    for formatted in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        formatted(FuncFormatter(_one_two_five))


def _one_two_five(value: float, _: int) -> str:
    """Return the label of a logarithmic axis at 1, 2 and 5 in each decade; others stay without."""
    return f"{value:g}" if f"{value:e}"[0] in "125" else ""


def _force(axes: Any, made: Design, palette: Palette) -> None:
    _band(axes, _levels(made), [p.ceiling_force for p in made.points], palette, 1.0, "expected", "corners")
    axes.axhline(made.motor.force, color=palette.accent, lw=1.2, label=f"the ceiling bears {made.motor.force:.4g} N")
    _title(axes, "Largest contact force on the ceiling", _level_name(made), "N")
    axes.set_ylim(0.0, None)
    _legend(axes)


def _tuned_mass(axes: Any, made: Design, palette: Palette) -> None:
    rows = made.tuned_mass.over_frequency
    x = [one.frequency for one in rows]
    for name, colour, style_, words in (
        ("bare", palette.accent, "-", "today, without a damper"), ("closed", palette.given_text, "-", "damper closed"),
        ("damper", palette.own, "-", "this damper, height held"), ("tuned", palette.ink, "--", "tuned mass"),
    ):  # fmt: skip
        axes.plot(x, [1e3 * getattr(one, name) for one in rows], color=colour, ls=style_, lw=1.6, label=words)
    for at in dict.fromkeys(made.frequencies):
        axes.axvline(at, color=palette.given, lw=0.8)
    title = f"Beside a tuned mass, at a {made.problem.drive} of {made.problem.level(rows[0].amplitude)}"
    _title(axes, title, "frequency of the excitation [Hz]", "mm, logarithmic")
    _logarithmic(axes)
    _legend(axes)
