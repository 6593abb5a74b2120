# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The charts of a report, declared once: panels of curves with their names, units, colours and limits.

`picture` draws them as PNG, `charts` on the page. Colours are names of `picture.Palette`.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from atpid_control.analysis.rows import shown_unit
from atpid_control.views.report.stages import per_cent
from atpid_control.views.report.view import View
from atpid_sim.system import Array

#: Widths of a line: in the picture [points], on the page [px].
_THIN, _LINE, _BROAD = (0.7, 1.1), (1.6, 1.8), (4.0, 4.5)
_REFERENCE, _WALL, _GRAIN = (0.6, 1.0), (1.4, 1.6), (2.0, 2.4)
#: Least error that is shown [%]; least change of the frequency, relative [-].
_SEEN, _CHANGED = 0.02, 0.005
#: Share of the time axis at its begin in which a centred text covers the ticks [-].
_EDGE = 0.035
#: A text centred at a time [s] and a height in the panel's unit.
Text = tuple[float, float, str]


@dataclass(frozen=True)
class Curve:
    """A line with its name beside its right end."""

    name: str
    time: Array  # (n,) [s]
    value: Array  # (n,) in the panel's unit
    colour: str
    widths: tuple[float, float]
    label: float  # height of its name, in the panel's unit
    side: int = 0  # the name a little above (1) or below (-1) that
    holds: bool = False  # whether each value stays until the next
    band: Array | None = None  # (n,) to either side of it, NaN where there is none

    @property
    def label_colour(self) -> str:
        """Colour of its name."""
        return "given_text" if self.colour == "given" else self.colour


@dataclass(frozen=True)
class Panel:
    """What is drawn over one piece of the time axis."""

    title: str
    unit: str
    share: float  # of the height
    curves: list[Curve] = field(default_factory=list)
    limits: tuple[float, float] = (0.0, 1.0)
    errors: tuple[Array, Array, Array] | None = None  # times [s], values and their bars to either side (n,)
    efficiencies: list[Text] = field(default_factory=list)
    heights: list[Text] = field(default_factory=list)  # in the picture; the page shows values under the pointer
    printed: list[Text] = field(default_factory=list)  # the thesis's
    walls: bool = False  # whether the first and the last curve are walls


@dataclass(frozen=True)
class Chart:
    """Panels below each other, over one time axis from `begin` to `end` [s]."""

    panels: list[Panel]
    begin: float
    end: float
    height: int  # on the page [px]
    windows: list[tuple[float, float]] = field(default_factory=list)  # where stages are measured [s]


def overview(view: View) -> Chart:
    """Return top to bottom: the beam, its excitation, the error of its identification, the ceiling."""
    panels = [_beam(view)]
    panels += [_excitation(view), *_error(view), *_frequency(view)] if view.stages else []
    panels += [_ceiling(view)] if view.moving else []
    return Chart(panels, 0.0, view.run.duration, 280 + 130 * len(panels), view.windows)


def _beam(view: View) -> Panel:
    time, reach, beam = view.run.motion.time, 1e3 * view.reach, 1e3 * view.beam
    closed = None if view.always_closed or view.closed is None else 1e3 * view.closed
    late = time > 0.9 * time[-1]
    top = float(np.nanmax(beam[late]))
    curves = []
    if closed is not None:
        label = max(float(np.nanmax(closed[late])), top + 0.16 * reach)
        curves.append(Curve("closed", time, closed, "given", _REFERENCE, label))
    curves.append(Curve(view.own_name, time, beam, "own", _THIN, 0.0 if closed is None else 0.5 * top))
    efficiencies = [
        (0.5 * (begin + end), 1.3 * reach, per_cent(stage.efficiency_range))
        for stage, (begin, end) in zip(view.stages, view.windows, strict=True)
        if closed is not None and math.isfinite(stage.efficiency)
    ]
    title = "Beam from rest" + ("; efficiency" if view.stages and closed is not None else "")
    limits = (-1.08 * reach, 1.34 * reach if view.stages else 1.08 * reach)
    return Panel(title, "mm", 3.4, curves, limits, efficiencies=efficiencies)


def _excitation(view: View) -> Panel:
    estimates, curves, top = view.run.estimates, [], 0.0
    scale, unit = shown_unit(view.run.drive.unit)
    if view.true_amplitude is not None:
        true = scale * view.true_amplitude
        curves.append(Curve("true", view.run.motion.time, true, "given", _BROAD, float(true[-1]), 1))
        top = float(true.max())
    steady = estimates.steady
    if steady.any():
        value = scale * estimates.amplitude
        band = np.where(steady, 2.0 * scale * estimates.amplitude_std, np.nan)
        last = float(value[steady][-1])
        curves.append(Curve("identified", estimates.time, value, "own", _LINE, last, -1, band=band))
        top = max(top, float(value[steady].max()))
    return Panel(f"{view.run.drive.name.capitalize()} amplitude", unit, 1.35, curves, (0.0, 1.22 * top or 1.0))


def _error(view: View) -> list[Panel]:
    """Return the panel of the error, none where it is unknown or too small to be seen."""
    if view.true_amplitude is None:
        return []
    estimates = view.run.estimates
    known = np.interp(estimates.time, view.run.motion.time, view.true_amplitude)
    steady = estimates.steady & (known > 0.0) & np.isfinite(estimates.amplitude_std)
    given = known[steady]
    error, bar = 100.0 * (estimates.amplitude[steady] / given - 1.0), 200.0 * estimates.amplitude_std[steady] / given
    largest = float(np.nanmax(np.abs(error) + bar, initial=0.0))
    if largest < _SEEN:
        return []
    limit = _rounded_up(largest)
    title, errors = "Error of the identified amplitude, ±2σ", (estimates.time[steady], error, bar)
    return [Panel(title, "%", 1.0, limits=(-limit, limit), errors=errors)]


def _frequency(view: View) -> list[Panel]:
    """Return the panel of the excitation's frequency, none where it does not change."""
    estimates, true = view.run.estimates, view.true_frequency
    found = np.where(estimates.steady, estimates.frequency, np.nan)
    values = np.concatenate(([] if true is None else [true]) or [found])
    low, high = float(np.nanmin(values, initial=np.inf)), float(np.nanmax(values, initial=-np.inf))
    if not high - low > _CHANGED * high:
        return []
    curves = [] if true is None else [Curve("true", view.run.motion.time, true, "given", _BROAD, float(true[-1]), 1)]
    if estimates.steady.any():
        last = float(found[estimates.steady][-1])
        curves.append(Curve("identified", estimates.time, found, "own", _LINE, last, -1))
    room = 0.15 * (high - low)
    return [Panel("Frequency of the excitation", "Hz", 1.35, curves, (low - room, high + room))]


def _rounded_up(value: float) -> float:
    """Return the next of 0.1, 0.2, 0.5, 1, 2, 5, ... above `value`."""
    first = max(-1, math.ceil(math.log10(value)) - 1) if value > 0.0 else -1
    return next(
        step * 10.0**power
        for power in range(first, first + 3)
        for step in (1.0, 2.0, 5.0)
        if step * 10.0**power >= value
    )


def _ceiling(view: View) -> Panel:
    sent, curves = view.run.commands, []
    heights_sent = 1e3 * sent.height
    known = np.isfinite(heights_sent)
    commanded = bool(known.any()) and view.own_name == "adaptive"
    if commanded:
        time, height = sent.time[known], heights_sent[known]
        curves.append(Curve("commanded", time, height, "given", _BROAD, float(height[-1]), 1, holds=True))
    motion, motor = view.run.motion, view.run.ceiling
    # the plant's own where it is known
    time, moved = (motion.time, 1e3 * motion.ceiling) if view.drawn_truth else (motor.time, 1e3 * motor.height)
    if len(moved):
        curves.append(Curve("moved", time, moved, "own", _LINE, float(moved[-1]), -1 if commanded else 0))
    top = float(np.nanmax(np.append(moved, heights_sent)))
    heights: list[Text] = []
    printed: list[Text] = []
    for number, (stage, (begin, end)) in enumerate(zip(view.stages, view.windows, strict=True)):
        middle = 0.5 * (begin + end)
        if view.own_name == "adaptive" and math.isfinite(stage.height):
            heights.append((middle, 1e3 * stage.height + 0.06 * top, f"{1e3 * stage.height:.3g}"))
        if view.printed:
            its = view.printed[number]
            printed.append((middle, 1e3 * its.height, f"thesis {its.height_sign}{1e3 * its.height:.0f}"))
            top = max(top, 1e3 * its.height)
    return Panel("Ceiling height", "mm", 1.5, curves, (0.0, 1.28 * top), heights=heights, printed=printed)


def grain(view: View) -> Chart | None:
    """Return floor, grain and ceiling over the last periods; None where the grain's position is unknown.

    In the grain's own coordinate, so that lines that touch are contacts.
    """
    motion, scene = view.run.motion, view.run.scene
    if view.grain_window is None or scene is None:
        return None
    begin, end = view.grain_window
    inside = (motion.time >= begin) & (motion.time <= end)
    floor = 1e3 * (motion.beam + scene.static_deflection)[inside]
    ceiling = floor + 1e3 * (motion.ceiling[inside] - 2.0 * scene.grain.radius)
    lines = [floor, 1e3 * (motion.grain + scene.static_deflection)[inside], ceiling]
    low, high = float(np.nanmin(floor)), float(np.nanmax(ceiling))
    labels = apart([float(line[-1]) for line in lines], 0.07 * (high - low))
    looks = (("floor", "given_text", _WALL), ("grain", "own", _GRAIN), ("ceiling", "given_text", _WALL))
    curves = [
        Curve(name, motion.time[inside], line, colour, widths, label)
        for (name, colour, widths), line, label in zip(looks, lines, labels, strict=True)
    ]
    space = 0.08 * (high - low) + 1e-3
    limits = (low - space, high + space)
    return Chart(
        [Panel("The grain between floor and ceiling", "mm", 2.261, curves, limits, walls=True)], begin, end, 360
    )


def anchor(share: float) -> str:
    """Return how a text at a share of the time axis [-] is aligned: at its begin it covers no tick beside it."""
    return "left" if share < _EDGE else "center"


def apart(heights: list[float], least: float) -> list[float]:
    """Return rising heights, moved so that neighbours are at least `least` apart: places for labels."""
    low, middle, high = heights
    if middle - low < least:
        return [middle - least, middle, high]
    return [low, middle, max(high, middle + least)]


def extremes(value: Array, points: int) -> NDArray[np.intp]:
    """Return at most about `points` indices of `value` (n,), rising: the highest and lowest of each bucket, the last.

    All of them where there are no more. NaN counts as zero.
    """
    if len(value) <= points:
        return np.arange(len(value))
    width = -(-len(value) // max(1, points // 2))
    starts = np.arange(0, len(value), width)
    blocks = [value[start : start + width] for start in starts]
    filled = [np.where(np.isfinite(block), block, 0.0) for block in blocks]
    low, high = (starts + [int(place(block)) for block in filled] for place in (np.argmin, np.argmax))
    return np.unique(np.concatenate([low, high, [len(value) - 1]]))
