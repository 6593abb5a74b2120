# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of the atlas: types of motion over amplitude, mass, frequency and height, best heights and cliffs."""

from pathlib import Path
from typing import Any

import numpy as np

from atpid_sim.figure_style import SIZE, WIDTH, drawn
from atpid_sim.system import Array
from studies.atlas.atlas import Atlas
from studies.atlas.column import FAILED, TYPES
from studies.atlas.plan import FREQUENCY, MASS

#: Colour and name of each type, in the order of `TYPES`.
_COLOURS = ("#1f3a5f", "#5b8fb9", "#35a77c", "#e58a5c", "#dcdcdc")
_NAMES = ("sticking", "mixed", "optimal", "irregular", "ceiling\nnot reached")
_LINES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("best_height", {"color": "white", "linewidth": 1.8, "label": "best height"}),
    ("cliff", {"color": "black", "linewidth": 0.6, "label": "cliff: stability ends"}),
)
#: Efficiencies to which lines are drawn [%].
_EFFICIENCIES = (20.0, 40.0, 60.0, 70.0)
#: Change of a best clearance from one column to the next that is a jump [-].
_JUMP = 0.12
#: Mosaic of the panels: M main, then mass fractions and slices.
_MOSAIC: dict[str, Any] = {"mosaic": "MMM;ABC;DEF", "height_ratios": (2.1, 1.0, 1.0)}
#: Labels that the thesis prints, at 10 % where no mass fraction is named (Figs 3.12 to 3.15): mass fraction,
#: amplitude [m], height [m], type.
THESIS = (
    (0.1, 0.01, 0.04, "sticking"), (0.1, 0.01, 0.08, "sticking"), (0.1, 0.01, 0.12, "sticking"),
    (0.1, 0.01, 0.16, "mixed"), (0.1, 0.01, 0.2, "optimal"), (0.1, 0.01, 0.3, "irregular"),
    (0.05, 0.01, 0.2, "sticking"), (0.2, 0.01, 0.2, "irregular"), (0.1, 0.005, 0.2, "no_ceiling"),
    (0.1, 0.0075, 0.2, "irregular"), (0.1, 0.02, 0.2, "sticking"),
)  # fmt: skip


def draw_atlas(atlas: Atlas, diameter: float, file: Path, thesis: bool) -> None:
    """Draw the atlas into a file; diameter: of the grain [m]; thesis: mark the labels the thesis prints.

    Heights are drawn as clearance over amplitude: but for gravity the equations scale with the amplitude.
    """
    rows = [(MASS, row, f"{100 * share:g} % of grain") for row, share in enumerate(atlas.plan.mass_fractions)]
    main = min(rows, key=lambda each: abs(atlas.plan.mass_fractions[each[1]] - atlas.plan.slice_fraction))
    others = [each for each in rows if each is not main][:3]
    slices = [
        (FREQUENCY, row, f"A = {1e3 * a:.3g} mm, {100 * atlas.plan.slice_fraction:g} %")
        for row, a in enumerate(atlas.plan.slices)
    ]
    with drawn(file, figsize=(WIDTH, 11.5), **_MOSAIC) as (figure, panels):
        _panel(panels["M"], atlas, main, diameter, thesis)
        _label_regions(panels["M"], atlas, main)
        _efficiency(panels["M"], atlas, main, diameter)
        for key, shown in zip("ABC", others, strict=False):
            _panel(panels[key], atlas, shown, diameter, thesis)
        for key, shown in zip("DEF", slices, strict=False):
            _panel(panels[key], atlas, shown, diameter, False)
        for axes in panels.values():
            axes.set_visible(axes.has_data())
        for key in "AD":
            panels[key].set_ylabel("(h − 2r) / A")
        main_axes = panels["M"]
        main_axes.set_title(f"Resonance, {100 * atlas.plan.slice_fraction:g} % of grain")
        main_axes.set_xlabel("amplitude of the support A [mm]")
        main_axes.set_ylabel("clearance over amplitude (h − 2r) / A [-]")
        _legend(figure, main_axes, thesis)
        figure.suptitle(f"The motions of a particle impact damper, {atlas.simulations:,} simulations")


def _panel(axes: Any, atlas: Atlas, shown: tuple[str, int, str], diameter: float, thesis: bool) -> None:
    """Draw one row of a block: types of the upward sweep, hysteresis, best height and cliff."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patheffects import Normal, Stroke

    block, row, title = shown
    part = {name: array[row] for name, array in atlas.blocks[block].items()}
    across, amplitude = _across(atlas, block, row)
    clearance = ((part["heights"] - diameter) / amplitude[:, None])[0]  # the same shares, so the same in each column
    types = np.ma.masked_equal(part["types"][:, :, 0], FAILED)
    axes.pcolormesh(
        across,
        clearance,
        types.T,
        cmap=ListedColormap(_COLOURS),
        vmin=-0.5,
        vmax=len(TYPES) - 0.5,
        shading="nearest",
        rasterized=True,
    )
    _hatch(axes, across, clearance, part["hysteresis"].T)
    for name, style in _LINES:
        outline = [Stroke(linewidth=style["linewidth"] + 1.6, foreground="black"), Normal()]
        axes.plot(*_broken(across, (part[name] - diameter) / amplitude), path_effects=outline, **style)
    if thesis:
        _mark_thesis(axes, atlas.plan.mass_fractions[row], diameter)
    if block == MASS:
        axes.set_xscale("log")
        ticks = [a for a in (1, 2, 5, 10, 20, 50, 100) if across[0] <= a <= across[-1]]
        axes.set_xticks(ticks, [str(a) for a in ticks])
        axes.minorticks_off()
    axes.set(title=title, xlim=(across[0], across[-1]), ylim=(0.0, float(clearance.max())))
    axes.set_xlabel("A [mm]" if block == MASS else "frequency over resonance")


def _across(atlas: Atlas, block: str, row: int) -> tuple[Array, Array]:
    """Return what is drawn across, [mm] or [-], and the amplitude of each column [m]."""
    if block == MASS:
        amplitudes = np.array(atlas.plan.amplitudes)
        return 1e3 * amplitudes, amplitudes
    ratios = np.array(atlas.plan.frequency_ratios)
    return ratios, np.full(len(ratios), atlas.plan.slices[row])


def _broken(x: Array, y: Array) -> tuple[Array, Array]:
    """Return a curve (n,) with gaps where it jumps from one well to another."""
    jumps = np.flatnonzero(np.abs(np.diff(y)) > _JUMP * np.maximum(y[:-1], y[1:])) + 1
    return np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan)


def _hatch(axes: Any, x: Array, y: Array, where: Array) -> None:
    if where.any():
        axes.contourf(x, y, where.astype(float), levels=[0.5, 1.5], colors="none", hatches=["//////"])


def _efficiency(axes: Any, atlas: Atlas, shown: tuple[str, int, str], diameter: float) -> None:
    """Draw lines of equal efficiency through the regular motions of the upward sweep."""
    block, row, _ = shown
    part = {name: array[row] for name, array in atlas.blocks[block].items()}
    across, amplitude = _across(atlas, block, row)
    clearance = ((part["heights"] - diameter) / amplitude[:, None])[0]
    below = part["heights"] <= part["best_height"][:, None]
    efficiency = np.where(below, 100.0 * (1.0 - part["amplitudes"][:, :, 0] / part["closed"][:, None]), np.nan)
    lines = axes.contour(across, clearance, efficiency.T, _EFFICIENCIES, colors="white", linewidths=0.8, alpha=0.8)
    axes.clabel(lines, fmt="%g %%", fontsize=SIZE)


def _label_regions(axes: Any, atlas: Atlas, shown: tuple[str, int, str]) -> None:
    """Write the name of each type where its region is widest."""
    from scipy.ndimage import distance_transform_edt

    block, row, _ = shown
    types = atlas.blocks[block]["types"][row, :, :, 0]
    for number, name in enumerate(_NAMES):
        inside = distance_transform_edt(np.pad(types == number, 1))[1:-1, 1:-1]
        i, j = np.unravel_index(int(np.argmax(inside)), inside.shape)
        if inside[i, j] < 2.0:
            continue
        spot = ((i + 0.5) / types.shape[0], (j + 0.5) / types.shape[1])
        colour = "white" if number < 2 else "black"
        axes.text(
            *spot,
            name,
            transform=axes.transAxes,
            ha="center",
            va="center",
            color=colour,
            fontsize=1.3 * SIZE,
            weight="bold",
        )


def _mark_thesis(axes: Any, mass_fraction: float, diameter: float) -> None:
    for fraction, amplitude, height, kind in THESIS:
        if abs(fraction - mass_fraction) < 1e-9:
            axes.scatter(
                [1e3 * amplitude], [(height - diameter) / amplitude], s=70, zorder=5, linewidths=1.5,
                color=_COLOURS[TYPES.index(kind)], edgecolors="white",
            )  # fmt: skip


def _legend(figure: Any, axes: Any, thesis: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    names = [name.replace("\n", " ") for name in _NAMES]
    handles: list[Any] = [Patch(facecolor=c, label=name) for c, name in zip(_COLOURS, names, strict=True)]
    handles.append(Patch(facecolor="white", edgecolor="black", hatch="//////", label="depends on the direction"))
    handles += axes.get_lines()
    if thesis:
        marker: dict[str, Any] = {
            "marker": "o",
            "markersize": 8,
            "markeredgecolor": "black",
            "markerfacecolor": "white",
        }
        handles.append(Line2D([], [], linestyle="none", label="the thesis's own label", **marker))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
