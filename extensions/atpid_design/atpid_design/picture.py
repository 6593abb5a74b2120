# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of a design: eight panels from the choice of the grain to a tuned mass of the same weight."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from atpid_design.make import Design
from atpid_design.worst_case import Interval
from atpid_sim.figure_style import LIGHT, Panels, logarithmic
from atpid_sim.system import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def panels(made: Design) -> Panels:
    """Return the panels of a design."""
    drawers = (_beam, _reduction, _grains, _efficiency, _heights, _cliff, _force, _tuned_mass)
    first = [partial(drawer, made=made) for drawer in drawers]
    return list(zip(first[::2], first[1::2], strict=True))


def mass(value: float) -> str:
    """Return a mass [kg] in words."""
    return f"{value:.3g} kg" if value >= 1.0 else f"{1e3 * value:.3g} g"


def _band(
    axes: Axes, x: Array, intervals: Sequence[Interval], scale: float, name: str, band: str = "all cases"
) -> None:
    expected, low, high = scale * np.array(intervals).T
    axes.fill_between(x, low, high, color=LIGHT.soft, lw=0.0, label=band)
    axes.plot(x, low, color=LIGHT.own, lw=0.8)
    axes.plot(x, high, color=LIGHT.own, lw=0.8)
    axes.plot(x, expected, "o-", color=LIGHT.own, ms=4.0, lw=1.8, label=name)


def _levels(made: Design) -> Array:
    return np.array([made.problem.unit[0] * one.amplitude for one in made.points])


def _level_name(made: Design) -> str:
    return f"{made.problem.drive} amplitude [{made.problem.unit[1]}]"


def _grains(axes: Axes, made: Design) -> None:
    sound = [one for one in made.candidates if not one.failure]
    x = np.array([1e3 * one.grain_mass for one in sound])
    aim = made.problem.aim
    expected, low, high = 100.0 * np.array([getattr(one, aim) for one in sound]).T
    unit, scale = ("kg", 1e-3) if x.max() > 1e3 else ("g", 1.0)
    axes.vlines(scale * x, low, high, color=LIGHT.soft, lw=6.0)
    axes.plot(scale * x, low, color=LIGHT.own, lw=1.2, label="least, over amplitudes and corners")
    axes.plot(scale * x, expected, "o", color=LIGHT.own, ms=4.0, label="least expected")
    axes.axvline(1e3 * scale * made.grain_mass, color=LIGHT.accent, lw=1.2, label=f"chosen: {mass(made.grain_mass)}")
    target = getattr(made.problem, f"target_{aim}")
    if target is not None:
        axes.axhline(100.0 * target, color=LIGHT.accent, ls="--", lw=1.0, label="target")
    axes.set(title="The grain: what each mass keeps", xlabel=f"mass of the grain [{unit}]", ylabel=f"{aim} [%]")
    axes.set_ylim(min(low.min(), 100.0 * getattr(made, aim)[0], 0.0) - 3.0, 100.0)
    axes.set_xlim(0.0, None)


def _efficiency(axes: Axes, made: Design) -> None:
    _band(axes, _levels(made), [p.efficiency for p in made.points], 100.0, "expected")
    bare = [100.0 * p.best_efficiency for p in made.points]
    axes.plot(_levels(made), bare, color=LIGHT.given, lw=1.2, ls="--", label="bare optimum")
    axes.set(title="Efficiency: against the closed damper", xlabel=_level_name(made), ylabel="efficiency [%]")
    _from_zero(axes)


def _reduction(axes: Axes, made: Design) -> None:
    _band(axes, _levels(made), [p.reduction for p in made.points], 100.0, "expected")
    axes.axhline(0.0, color=LIGHT.accent, lw=1.2, label="as without the damper; below: worse")
    axes.set(title="Reduction: against the structure of today", xlabel=_level_name(made), ylabel="reduction [%]")
    _from_zero(axes)


def _from_zero(axes: Axes) -> None:
    """Let an axis in per cent include 0 and 100."""
    axes.set_ylim(min(axes.get_ylim()[0], 0.0), 102.0)


def _heights(axes: Axes, made: Design) -> None:
    x = _levels(made)
    best = [1e3 * p.best_height for p in made.points]
    axes.plot(x, best, color=LIGHT.given, lw=1.2, ls="--", label="bare optimum")
    axes.plot(x, [1e3 * p.height for p in made.points], "o-", color=LIGHT.own, ms=4.0, lw=1.8, label="design")
    axes.axhline(2e3 * made.radius, color=LIGHT.given, lw=1.2, label="closed: the grain's diameter")
    axes.set(title="Height of the ceiling", xlabel=_level_name(made), ylabel="mm")
    axes.set_ylim(0.0, None)


def _cliff(axes: Axes, made: Design) -> None:
    found = made.landscape
    heights = 1e3 * found.heights
    axes.plot(heights, 100.0 * found.cases, color=LIGHT.given, lw=0.7)
    axes.plot([], [], color=LIGHT.given, lw=0.7, label="corners of the box")
    axes.plot(heights, 100.0 * found.given, color=LIGHT.own, lw=1.8, label="given structure")
    (point,) = [one for one in made.points if one.amplitude == found.amplitude]
    axes.axvline(1e3 * point.height, color=LIGHT.accent, lw=1.2, label=f"design: {1e3 * point.height:.1f} mm")
    title = f"Amplitude over the height, at a {made.problem.drive} of {made.problem.level(found.amplitude)}"
    axes.set(title=title, xlabel="height of the ceiling [mm]", ylabel="% of the closed damper's")
    axes.set_ylim(0.0, min(100.0, 125.0 * float(np.nanmax(found.cases))))


def _beam(axes: Axes, made: Design) -> None:
    x = _levels(made)
    axes.plot(x, [1e3 * p.closed_amplitude for p in made.points], color=LIGHT.given_text, lw=1.4, label="damper closed")
    bare = [1e3 * p.bare_amplitude.expected for p in made.points]
    axes.plot(x, bare, color=LIGHT.accent, lw=1.4, label="today, without the damper")
    _band(axes, x, [p.beam_amplitude for p in made.points], 1e3, "with the damper")
    axes.set(title="Amplitude of the structure", xlabel=_level_name(made), ylabel="mm, logarithmic")
    logarithmic(axes)


def _force(axes: Axes, made: Design) -> None:
    _band(axes, _levels(made), [p.ceiling_force for p in made.points], 1.0, "expected", "corners")
    axes.axhline(made.motor.force, color=LIGHT.accent, lw=1.2, label=f"the ceiling bears {made.motor.force:.4g} N")
    axes.set(title="Largest contact force on the ceiling", xlabel=_level_name(made), ylabel="N")
    axes.set_ylim(0.0, None)


def _tuned_mass(axes: Axes, made: Design) -> None:
    rows = made.tuned_mass.over_frequency
    x = [one.frequency for one in rows]
    for name, colour, words in (
        ("bare", LIGHT.accent, "today, without a damper"),
        ("closed", LIGHT.given_text, "damper closed"),
        ("damper", LIGHT.own, "this damper, height held"),
        ("tuned", LIGHT.ink, "tuned mass"),
    ):
        dashes = "--" if name == "tuned" else "-"
        axes.plot(x, [1e3 * getattr(one, name) for one in rows], color=colour, ls=dashes, lw=1.6, label=words)
    for at in dict.fromkeys(made.frequencies):
        axes.axvline(at, color=LIGHT.given, lw=0.8)
    title = f"Beside a tuned mass, at a {made.problem.drive} of {made.problem.level(rows[0].amplitude)}"
    axes.set(title=title, xlabel="frequency of the excitation [Hz]", ylabel="mm, logarithmic")
    logarithmic(axes)


#: Width of the drawing and height of the part that is to scale, and the room above and below.
_WIDE, _TALL, _MARGIN = 520.0, 220.0, 34.0


def sketch(made: Design) -> dict[str, object]:
    """Return the places of the page's drawing; lengths are those of the design in millimetres, widths are free."""
    (low, high), diameter = made.heights, 2.0 * made.radius
    scale, left, floor = _TALL / high, 126.0, _MARGIN + _TALL
    right = left + max(1.6 * diameter * scale, 60.0)
    ceilings, last = [], floor + 20.0
    for number, (name, height) in enumerate((("closed", diameter), ("lowest", low), ("highest", high))):
        level = floor - height * scale
        last = min(level, last - 20.0)  # of the words, which do not overlap
        words = f"{1e3 * height:.1f} mm, {name}"
        ceilings.append({"name": name, "level": level, "x": right + 22.0 + 16.0 * number, "at": last, "words": words})
    travel = ("travel", f"{1e3 * (high - low):.1f} mm", "from closed", f"{1e3 * (high - diameter):.1f} mm")
    return {
        "left": left,
        "right": right,
        "floor": floor,
        "top": _MARGIN - 12.0,
        "radius": 0.5 * diameter * scale,
        "ceilings": ceilings,
        "travel": travel,
        "middle": floor - 0.5 * (low + high) * scale,
        "wide": max(_WIDE, right + 232.0),
        "tall": floor + _MARGIN,
    }
