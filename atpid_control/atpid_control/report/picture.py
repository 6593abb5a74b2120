# SPDX-License-Identifier: Apache-2.0
"""The pictures as PNG, for README and papers; the page draws the same from the same view."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from atpid_control.report.thinning import extremes
from atpid_control.report.view import View
from atpid_sim.figure_numbers import metadata_of
from atpid_sim.system import Array


@dataclass(frozen=True)
class Palette:
    """Colours of one scheme: grey for the given excitation and the closed damper, blue for the damper.

    Orange is kept for the thesis's printed figures and for warnings. The contrast of text is at least 4.5 to 1.
    """

    paper: str
    ink: str
    muted: str  # axes, captions
    grid: str
    given: str  # the closed damper, the true excitation, the command
    given_text: str  # the same where it is text
    own: str  # the damper, the estimate, the ceiling
    soft: str  # the same, as an area
    accent: str  # the thesis's figures, warnings
    window: str  # where a stage is measured


LIGHT = Palette(
    paper="#ffffff", ink="#1a1d21", muted="#5f6770", grid="#e7e9ec", given="#b4bac1", given_text="#6b727a",
    own="#0f6aa3", soft="#cfe3f0", accent="#b4540a", window="#f2f5f8",
)  # fmt: skip
DARK = Palette(
    paper="#14171b", ink="#e9ebee", muted="#9aa2ab", grid="#2a2f36", given="#5b646e", given_text="#98a1ab",
    own="#62b2e6", soft="#1d3b50", accent="#eb9b57", window="#1b2026",
)  # fmt: skip
SCHEMES = {"light": LIGHT, "dark": DARK}


_DPI = 160
_SIZE = 9.5
#: A curve longer than this is drawn with so many of its points.
_LONG, _POINTS = 200_000, 20_000


def save_pictures(view: View, folder: Path) -> list[Path]:
    """Draw every picture the run has, light and dark; return the files written."""
    written = []
    for scheme, palette in SCHEMES.items():
        drawn = {"overview": overview(view, palette), "grain": grain(view, palette)}
        for name, figure in drawn.items():
            if figure is not None:
                path = folder / (f"{name}.png" if scheme == "light" else f"{name}-{scheme}.png")
                figure.savefig(path, dpi=_DPI, metadata=metadata_of(figure))
                written.append(path)
    return written


def style(palette: Palette) -> Any:
    """Return matplotlib's settings for a palette."""
    return {
        "font.family": "DejaVu Sans", "font.size": _SIZE, "axes.edgecolor": palette.grid, "axes.linewidth": 0.8,
        "axes.facecolor": palette.paper, "figure.facecolor": palette.paper, "savefig.facecolor": palette.paper,
        "axes.labelcolor": palette.muted, "text.color": palette.ink, "xtick.color": palette.muted,
        "ytick.color": palette.muted, "xtick.major.size": 0.0, "ytick.major.size": 0.0, "axes.grid": True,
        "grid.color": palette.grid, "grid.linewidth": 0.8, "axes.axisbelow": True, "axes.spines.top": False,
        "axes.spines.right": False, "axes.spines.left": False, "lines.solid_capstyle": "round",
    }  # fmt: skip


def overview(view: View, palette: Palette) -> Figure:
    """Draw top to bottom: the beam, its excitation, the error of its identification, the ceiling."""
    panels = [(_beam, 3.4)]
    panels += [(_excitation, 1.35), (_error, 1.0)] if view.stages else []
    panels += [(_ceiling, 1.5)] if view.moving else []
    with matplotlib.rc_context(style(palette)):
        height = 1.0 + 1.15 * sum(share for _, share in panels)
        figure = Figure(figsize=(11.0, height))
        grid = figure.add_gridspec(
            len(panels), height_ratios=[share for _, share in panels], hspace=0.42 if view.stages else 0.3,
            left=0.065, right=0.895, top=1.0 - 0.38 / height, bottom=0.55 / height,
        )  # fmt: skip
        first = None
        for row, (draw, _) in enumerate(panels):
            axes = figure.add_subplot(grid[row], sharex=first)
            first = first or axes
            axes.set_xlim(0.0, view.run.duration)
            axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
            axes.tick_params(labelbottom=row == len(panels) - 1)
            for begin, end in view.windows:
                axes.axvspan(begin, end, color=palette.window, lw=0.0, zorder=0)
            draw(axes, view, palette)
        axes.set_xlabel("time, s")
    return figure


def _title(axes: Any, text: str, unit: str, palette: Palette) -> None:
    axes.set_title(text, loc="left", fontsize=_SIZE + 0.5, fontweight="bold", color=palette.ink, pad=7)
    axes.annotate(
        unit, (0.0, 1.0), xytext=(-4, 7), xycoords="axes fraction", textcoords="offset points", ha="right", va="bottom",
        color=palette.muted,
    )  # fmt: skip


def _beside(axes: Any, height: float, text: str, colour: str, shift: float = 0.0) -> None:
    """Write a direct label at the right edge, at data height `height`."""
    axes.annotate(
        text, (1.0, height), xytext=(7, shift), xycoords=("axes fraction", "data"), textcoords="offset points",
        va="center", color=colour, fontweight="bold", annotation_clip=False,
    )  # fmt: skip


def _curve(axes: Any, time: Array, value: Array, **style: Any) -> None:
    """Draw a curve; of a run of hours only its extremes, since matplotlib needs 100 bytes a point and more."""
    chosen = extremes(value, _POINTS) if len(value) > _LONG else slice(None)
    axes.plot(time[chosen], value[chosen], **style)


def _beam(axes: Any, view: View, palette: Palette) -> None:
    time = view.run.motion.time
    alone = view.always_closed or view.closed is None
    _title(axes, beam_title(view, alone), "m", palette)
    if not alone and view.closed is not None:
        _curve(axes, time, view.closed, color=palette.given, lw=0.6)
    _curve(axes, time, view.beam, color=palette.given_text if view.always_closed else palette.own, lw=0.7)
    reach = view.reach
    axes.set_ylim(-1.08 * reach, 1.34 * reach if view.stages else 1.08 * reach)
    last = time > 0.9 * time[-1]
    own_top = float(np.nanmax(view.beam[last]))
    if not alone and view.closed is not None:
        closed_top = max(float(np.nanmax(view.closed[last])), own_top + 0.16 * reach)
        _beside(axes, closed_top, "closed", palette.given_text)
    _beside(axes, 0.0 if alone else 0.5 * own_top, view.own_name, palette.own)
    for stage, (begin, end) in zip(view.stages, view.windows, strict=True):
        if alone or not math.isfinite(stage.efficiency):
            continue
        style = {"ha": "center", "va": "top", "fontsize": _SIZE + 5.5, "fontweight": "bold"}
        axes.text(0.5 * (begin + end), 1.31 * reach, stage.efficiency_text(), color=palette.own, **style)


def beam_title(view: View, alone: bool) -> str:
    """Return the title of the beam's panel; `alone`: without a closed damper beside it."""
    return "Beam displacement from rest" if alone or not view.stages else "Beam displacement from rest; efficiency"


def _excitation(axes: Any, view: View, palette: Palette) -> None:
    estimates = view.run.estimates
    _title(axes, "Support amplitude", "mm", palette)
    top = 0.0
    if view.true_amplitude is not None:
        _curve(axes, view.run.motion.time, 1e3 * view.true_amplitude, color=palette.given, lw=4.0)
        top = 1e3 * float(view.true_amplitude.max())
        _beside(axes, 1e3 * float(view.true_amplitude[-1]), "true", palette.given_text, 7.0)
    steady = estimates.steady
    if steady.any():
        value, width = 1e3 * estimates.amplitude, 2e3 * estimates.amplitude_std
        axes.fill_between(estimates.time, value - width, value + width, where=steady, color=palette.soft, lw=0.0)
        axes.plot(estimates.time, value, color=palette.own, lw=1.6)
        _beside(axes, float(value[steady][-1]), "identified", palette.own, -7.0)
        top = max(top, float(value[steady].max()))
    axes.set_ylim(0.0, 1.22 * top or 1.0)


def _error(axes: Any, view: View, palette: Palette) -> None:
    _title(axes, "Error of the identified amplitude, ±2σ", "%", palette)
    found = estimate_errors(view)
    if found is None:
        return
    time, error, width = found
    chosen = extremes(error, _POINTS)
    time, error, width = time[chosen], error[chosen], width[chosen]
    axes.vlines(time, error - width, error + width, color=palette.soft, lw=1.8)
    axes.plot(time, error, ".", color=palette.own, ms=3.0, mew=0.0)
    axes.axhline(0.0, color=palette.given, lw=0.8, zorder=1)
    limit = rounded_up(float(np.nanmax(np.abs(error) + width)))
    axes.set_ylim(-limit, limit)
    axes.set_yticks([-limit, 0.0, limit])


def estimate_errors(view: View) -> tuple[Any, Any, Any] | None:
    """Return times [s], relative errors [%] and their two standard deviations [%] of the steady estimates."""
    if view.true_amplitude is None:
        return None
    known = np.interp(view.run.estimates.time, view.run.motion.time, view.true_amplitude)
    steady = view.run.estimates.steady & (known > 0.0) & np.isfinite(view.run.estimates.amplitude_std)
    if not steady.any():
        return None
    time, given = view.run.estimates.time[steady], known[steady]
    error = 100.0 * (view.run.estimates.amplitude[steady] / given - 1.0)
    return time, error, 200.0 * view.run.estimates.amplitude_std[steady] / given


def rounded_up(value: float) -> float:
    """Return the next of 0.1, 0.2, 0.5, 1, 2, 5, ... above `value`."""
    first = max(-1, math.ceil(math.log10(value)) - 1) if value > 0.0 else -1
    return next(
        step * 10.0**power
        for power in range(first, first + 3)
        for step in (1.0, 2.0, 5.0)
        if step * 10.0**power >= value
    )


def _ceiling(axes: Any, view: View, palette: Palette) -> None:
    ceiling = view.run.ceiling
    _title(axes, "Ceiling height", "m", palette)
    sent = np.isfinite(ceiling.commanded)
    if sent.any() and view.own_name == "adaptive":
        axes.step(ceiling.commanded_time[sent], ceiling.commanded[sent], where="post", color=palette.given, lw=4.0)
        _beside(axes, float(ceiling.commanded[sent][-1]), "commanded", palette.given_text, 7.0)
    time, height = moved(view)
    top = float(np.nanmax(np.append(height, ceiling.commanded)))
    if len(height):
        _curve(axes, time, height, color=palette.own, lw=1.6)
        _beside(axes, float(height[-1]), "moved", palette.own, -7.0 if sent.any() else 0.0)
    for number, (stage, (begin, end)) in enumerate(zip(view.stages, view.windows, strict=True)):
        middle = 0.5 * (begin + end)
        if view.own_name == "adaptive" and math.isfinite(stage.height):
            text, above = f"{stage.height:.3f}", stage.height + 0.06 * top
            axes.text(middle, above, text, ha="center", va="bottom", color=palette.own)
        if view.printed:
            printed = view.printed[number]
            axes.plot(middle, printed.height, "D", color=palette.accent, ms=4.5, mec=palette.paper, mew=0.8, zorder=5)
            axes.annotate(
                f"thesis {printed.height_sign}{printed.height:.2g}", (middle, printed.height), xytext=(0, -7),
                textcoords="offset points", ha="center", va="top", color=palette.accent,
            )  # fmt: skip
            top = max(top, printed.height)
    axes.set_ylim(0.0, 1.28 * top)


def moved(view: View) -> tuple[Any, Any]:
    """Return times [s] and heights [m] of the ceiling: the plant's own where it is known, else the motor's."""
    if view.run.simulated:
        return view.run.motion.time, view.run.motion.ceiling
    return view.run.ceiling.time, view.run.ceiling.height


def grain(view: View, palette: Palette) -> Figure | None:
    """Draw the grain between floor and ceiling over the last periods; None where its position is unknown."""
    if view.grain_window is None:
        return None
    begin, end = view.grain_window
    motion = view.run.motion
    inside = (motion.time >= begin) & (motion.time <= end)
    time = motion.time[inside] - begin
    floor, ceiling, ball = grain_lines(view)
    with matplotlib.rc_context(style(palette)):
        figure = Figure(figsize=(11.0, 3.6))
        axes = figure.add_axes((0.065, 0.16, 0.83, 0.71))
        _title(axes, "The grain between floor and ceiling", "m", palette)
        low, high = float(floor[inside].min()), float(ceiling[inside].max())
        space = 0.08 * (high - low) + 1e-6
        axes.fill_between(time, low - space, floor[inside], color=palette.window, lw=0.0)
        axes.fill_between(time, ceiling[inside], high + space, color=palette.window, lw=0.0)
        axes.plot(time, floor[inside], color=palette.given_text, lw=1.4)
        axes.plot(time, ceiling[inside], color=palette.given_text, lw=1.4)
        axes.plot(time, ball[inside], color=palette.own, lw=2.0)
        axes.set_xlim(0.0, end - begin)
        axes.set_ylim(low - space, high + space)
        axes.set_xlabel(f"time since {begin:.2f} s, s")
        ends = [float(line[inside][-1]) for line in (floor, ball, ceiling)]
        names = (("floor", palette.given_text), ("grain", palette.own), ("ceiling", palette.given_text))
        for (name, colour), height in zip(names, apart(ends, 0.07 * (high - low)), strict=True):
            _beside(axes, height, name, colour)
    return figure


def apart(heights: list[float], least: float) -> list[float]:
    """Return rising heights, moved so that neighbours are at least `least` apart: places for labels."""
    low, middle, high = heights
    if middle - low < least:
        return [middle - least, middle, high]
    return [low, middle, max(high, middle + least)]


def grain_lines(view: View) -> tuple[Any, Any, Any]:
    """Return floor, ceiling and grain (n,) [m] in the grain's own coordinate, so that touching lines are contacts."""
    motion, scene = view.run.motion, view.run.scene
    assert scene is not None
    rest, diameter = scene.static_deflection, 2.0 * scene.grain.radius
    return motion.beam + rest, motion.beam + rest + motion.ceiling - diameter, motion.grain + rest
