# SPDX-License-Identifier: Apache-2.0
"""Height selection: the cliff, the margin, the error of the PCA, the map (docs/selection.md)."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from atpid_common import output
from atpid_common.folders import share_folder
from atpid_control.studies.selection import landscape, margin_curve, pca_errors
from atpid_sim.display import working
from atpid_sim.figure_numbers import metadata_of
from atpid_sim.maps import HeightMap

#: Support amplitudes of the thesis's adaptive bench [m].
_STAGES = (0.015, 0.03, 0.04)
#: Beyond this the grain is pressed deeper into a wall than its radius, and the contact law ends [m].
_DEEPEST = 0.1
_SHIPPED = "config/maps/standard.npz"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this figure's arguments."""
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder the pictures go to")
    parser.add_argument("--map", type=Path, help="height map to draw; default: the shipped one")


def run(args: argparse.Namespace) -> int:
    """Draw the figures; return the exit status."""
    output.folder(args.out)
    for draw in (draw_landscape, draw_margin, draw_pca_errors):
        with working(draw.__name__.replace("_", "ing ", 1).replace("_", " ")):
            made = draw(args.out)
        print(made)
    print(draw_map(args.out, HeightMap.load(args.map or share_folder("atpid_control") / _SHIPPED)))
    return 0


def draw_landscape(out: Path) -> Path:
    """Draw the beam's amplitude over the height, with the cliff."""
    figure, panels = _panels(len(_STAGES), "height of the ceiling [m]")
    for axes, amplitude in zip(panels, _STAGES, strict=True):
        shown = landscape(amplitude)
        axes.fill_between(shown.heights, shown.remaining.min(1), shown.remaining.max(1), color="C3", alpha=0.3)
        axes.plot(shown.heights, shown.remaining[:, 0], "C0", linewidth=1.2, label="opened in 1 s")
        axes.plot(shown.heights, shown.remaining[:, 1], "C3", linewidth=0.8, label="opened at once")
        axes.axvline(shown.best, color="k", linewidth=1.0, label=f"best: {shown.best:.3f} m")
        guess = f"PCA's first guess: {shown.first_guess:.3f} m"
        axes.axvline(shown.first_guess, color="C1", linestyle="--", label=guess)
        axes.set(title=f"support {1e3 * amplitude:g} mm", ylim=(0.0, 0.8))
        axes.legend(fontsize=7)
    panels[0].set_ylabel("beam amplitude / closed damper's [-]")
    return _save(figure, out / "selection_cliff.png")


def draw_margin(out: Path) -> Path:
    """Draw the amplitudes at the bare optimum and the safe height over the error of the stiffness."""
    figure, panels = _panels(len(_STAGES), "error of the stiffness [%]")
    for axes, amplitude in zip(panels, _STAGES, strict=True):
        shown = margin_curve(amplitude)
        bare, safe = f"bare optimum, {shown.bare_height:.3f} m", f"with margin, {shown.safe_height:.3f} m"
        axes.plot(1e2 * shown.errors, shown.bare, "C3o-", markersize=3, label=bare)
        axes.plot(1e2 * shown.errors, shown.safe, "C0o-", markersize=3, label=safe)
        title = f"support {1e3 * amplitude:g} mm, price {1e2 * shown.price:.1f} % of efficiency"
        axes.set(title=title, ylim=(0.0, 0.5))
        axes.legend(fontsize=7)
    panels[0].set_ylabel("beam amplitude / closed damper's [-]")
    return _save(figure, out / "selection_margin.png")


def draw_pca_errors(out: Path) -> Path:
    """Draw Figs 4.37 to 4.43 again, with the tuned PCA and the direct selection beside."""
    figure, panels = _panels(2, "support amplitude [m]", rows=2)
    amplitudes = np.geomspace(0.002, _DEEPEST, 36)
    for column, gravity in enumerate((True, False)):
        errors = pca_errors(amplitudes, gravity=gravity)
        series = (
            ("PCA before tuning (the thesis's measure)", "C1", errors.before, errors.lost_before),
            ("PCA tuned", "C2", errors.after, errors.lost_after),
            ("direct", "C0", errors.direct, errors.lost_direct),
        )
        upper, lower = panels[column], panels[2 + column]
        for name, colour, height, lost in series:
            upper.semilogx(amplitudes, 1e2 * np.abs(height), f"{colour}o-", markersize=3, linewidth=1.0, label=name)
            lower.semilogx(amplitudes, 1e2 * lost, f"{colour}o-", markersize=3, linewidth=1.0, label=name)
        upper.set(title="with gravity" if gravity else "without gravity", ylim=(-2.0, 80.0))
        lower.set(ylim=(-5.0, 150.0))
    # what the thesis reports: 50 to 10 % up to 0.1 m with gravity, about 4 % throughout without
    shade: dict[str, Any] = {"color": "k", "alpha": 0.12}
    panels[0].fill_between([0.005, 0.1], [40.0, 8.0], [55.0, 12.0], label="thesis, Fig. 4.37", **shade)
    panels[1].fill_between([0.005, 0.1], [3.0, 3.0], [5.0, 5.0], label="thesis, Fig. 4.43", **shade)
    panels[0].set_ylabel("height off the best by [%]")
    panels[2].set_ylabel("beam swings more than at the best by [%]")
    for axes in panels[:2]:
        axes.legend(fontsize=7)
    return _save(figure, out / "selection_pca_error.png")


def draw_map(out: Path, shown: HeightMap) -> Path:
    """Draw the best heights and their efficiencies, as Figs 4.39 and 4.46."""
    figure, (left, right) = _panels(2, "support amplitude [mm]")
    for row, fraction in enumerate(shown.mass_fractions):
        label = f"grain {1e2 * fraction:g} %"
        left.plot(1e3 * shown.amplitudes, shown.heights[row], f"C{row}.-", markersize=3, label=label)
        right.plot(1e3 * shown.amplitudes, 1e2 * shown.efficiencies[row], f"C{row}.-", markersize=3, label=label)
    left.set(ylabel="best height [m]")
    right.set(ylabel="efficiency [%]", ylim=(0.0, 100.0))
    left.legend(fontsize=8)
    return _save(figure, out / "selection_map.png")


def _panels(columns: int, xlabel: str, rows: int = 1) -> tuple[Any, list[Any]]:
    figure = Figure(figsize=(4.6 * columns, 3.8 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col")
    for axes in grid.flat:
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel(xlabel)
    return figure, list(grid.flat)


def _save(figure: Any, path: Path) -> Path:
    with output.writing(path):
        figure.savefig(path, dpi=130, metadata=metadata_of(figure))
    return path
