# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Height selection: the cliff, the margin, the error of the PCA, the map (docs/selection.md)."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_common.folders import share_folder
from atpid_control.selection.direct import DirectSelector
from atpid_control.selection.margin import MarginBox
from atpid_control.selection.pca import PcaSelector
from atpid_control.selection.protocol import Excitation
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, WIDTH, drawn
from atpid_sim.maps import DamperResponse, HeightMap, Timing
from atpid_sim.scene import standard_bench
from atpid_sim.simulation.batch import on_all_cores
from atpid_sim.system import Array
from studies.thorough_search import thorough_best

#: Support amplitudes of the thesis's adaptive bench [m].
_STAGES = (0.015, 0.03, 0.04)
#: Beyond this the grain is pressed deeper into a wall than its radius, and the contact law ends [m].
_DEEPEST = 0.1
_SHIPPED = "config/maps/standard.npz"
#: Tolerance of the simulations, and mass fraction of the grain [-].
_RTOL, _MASS_FRACTION = 1e-5, 0.1
#: Tolerance of the runs with a stiffness that is off: 0.2 % of an amplitude is resolved.
_CHANGED_RTOL = 1e-4
#: Time for a selection with a margin, so that a figure does not depend on how busy the machine is [s].
_UNHURRIED = 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this figure's arguments."""
    parser.add_argument("--out", type=file_path, default=Path("docs/figures"), help="folder the pictures go to")
    parser.add_argument("--map", type=file_path, help="height map to draw; default: the shipped one")


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
    path = out / "selection_cliff.png"
    with drawn(path, ncols=len(_STAGES), sharey=True, figsize=(WIDTH, 3.8)) as (figure, panels):
        for axes, amplitude in zip(panels, _STAGES, strict=True):
            heights, remaining, best, guess = landscape(amplitude)
            axes.fill_between(heights, remaining.min(1), remaining.max(1), color="C3", alpha=0.3)
            axes.plot(heights, remaining[:, 0], "C0", linewidth=1.2, label="opened in 1 s")
            axes.plot(heights, remaining[:, 1], "C3", linewidth=0.8, label="opened at once")
            axes.axvline(best, color=LIGHT.ink, linewidth=1.0, label="best")
            axes.axvline(guess, color="C1", linestyle="--", label="PCA's first guess")
            axes.set(title=f"support {1e3 * amplitude:g} mm", ylim=(0.0, 0.8))
            axes.set_xlabel(f"height of the ceiling [m]\nbest {best:.3f}, first guess {guess:.3f}")
        panels[0].set_ylabel("beam amplitude / closed damper's [-]")
        _legend(figure, panels[0])
    return path


def draw_margin(out: Path) -> Path:
    """Draw the amplitudes at the bare optimum and the safe height over the error of the stiffness."""
    path = out / "selection_margin.png"
    with drawn(path, ncols=len(_STAGES), sharey=True, figsize=(WIDTH, 3.8)) as (figure, panels):
        for axes, amplitude in zip(panels, _STAGES, strict=True):
            shown = margin_curve(amplitude)
            axes.plot(1e2 * shown.errors, shown.bare, "C3o-", markersize=3, label="bare optimum")
            axes.plot(1e2 * shown.errors, shown.safe, "C0o-", markersize=3, label="with margin")
            axes.set(title=f"support {1e3 * amplitude:g} mm", ylim=(0.0, 0.4))
            heights = f"{shown.bare_height:.3f} m, with margin {shown.safe_height:.3f} m"
            price = f"price {1e2 * shown.price:.1f} % of efficiency"
            axes.set_xlabel(f"error of the stiffness [%]\nbare {heights}\n{price}")
        panels[0].set_ylabel("beam amplitude / closed damper's [-]")
        _legend(figure, panels[0])
    return path


def draw_pca_errors(out: Path) -> Path:
    """Draw Figs 4.37 to 4.43 again, with the tuned PCA and the direct selection beside."""
    path = out / "selection_pca_error.png"
    amplitudes = np.geomspace(0.002, _DEEPEST, 36)
    with drawn(path, nrows=2, ncols=2, sharex=True, sharey="row", figsize=(WIDTH, 6.4)) as (figure, panels):
        for column, gravity in enumerate((True, False)):
            errors = pca_errors(amplitudes, gravity=gravity)
            series = (
                ("PCA before tuning (the thesis's measure)", "C1", errors.before, errors.lost_before),
                ("PCA tuned", "C2", errors.after, errors.lost_after),
                ("direct", "C0", errors.direct, errors.lost_direct),
            )
            upper, lower = panels[:, column]
            for name, colour, height, lost in series:
                upper.semilogx(amplitudes, 1e2 * np.abs(height), f"{colour}o-", markersize=3, linewidth=1.0, label=name)
                lower.semilogx(amplitudes, 1e2 * lost, f"{colour}o-", markersize=3, linewidth=1.0)
            upper.set(title="with gravity" if gravity else "without gravity", ylim=(-2.0, 80.0))
            lower.set(ylim=(-5.0, 150.0), xlabel="support amplitude [m]")
        # what the thesis reports: 50 to 10 % up to 0.1 m with gravity, about 4 % throughout without
        shade: dict[str, Any] = {"color": LIGHT.ink, "alpha": 0.12, "label": "thesis, Figs 4.37 and 4.43"}
        panels[0, 0].fill_between([0.005, 0.1], [40.0, 8.0], [55.0, 12.0], **shade)
        panels[0, 1].fill_between([0.005, 0.1], [3.0, 3.0], [5.0, 5.0], **shade)
        panels[0, 0].set_ylabel("height off the best by [%]")
        panels[1, 0].set_ylabel("beam swings more than at the best by [%]")
        _legend(figure, panels[0, 0])
    return path


def draw_map(out: Path, shown: HeightMap) -> Path:
    """Draw the best heights and their efficiencies, as Figs 4.39 and 4.46."""
    path = out / "selection_map.png"
    with drawn(path, ncols=2, figsize=(WIDTH, 3.8)) as (figure, (left, right)):
        for row, fraction in enumerate(shown.mass_fractions):
            label = f"grain {1e2 * fraction:g} %"
            left.plot(1e3 * shown.amplitudes, shown.heights[row], f"C{row}.-", markersize=3, label=label)
            right.plot(1e3 * shown.amplitudes, 1e2 * shown.efficiencies[row], f"C{row}.-", markersize=3)
        left.set(xlabel="support amplitude [mm]", ylabel="best height [m]")
        right.set(xlabel="support amplitude [mm]", ylabel="efficiency [%]", ylim=(0.0, 100.0))
        _legend(figure, left)
    return path


def _legend(figure: Any, axes: Any) -> None:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def landscape(amplitude: float) -> tuple[Array, Array, float, float]:
    """Return the beam's amplitude over the height of the standard bench's ceiling at a support `amplitude` [m].

    Heights (n,) [m]; amplitudes over that of the closed damper (n, 2) [-], opened slowly and at once; the best height
    and the PCA's first guess [m].
    """
    scene = standard_bench().with_(mass_fraction=_MASS_FRACTION)
    damper = DamperResponse(scene, _RTOL)
    best = thorough_best(damper, amplitude).height
    heights = np.linspace(0.3 * best, 1.6 * best, 120)
    timing, closed = Timing(1.5 * damper.settling(), 16.0), damper.closed_amplitude(amplitude)

    def remaining(height: float) -> tuple[float, float]:
        slow, sudden = (damper.opened(amplitude, height, timing, travel).amplitude / closed for travel in (1.0, 0.0))
        return slow, sudden

    found = dict(on_all_cores(remaining, [float(h) for h in heights]))
    guess = PcaSelector(scene).select(Excitation(amplitude)).stages[1].height
    return heights, np.array([found[float(h)] for h in heights]), best, guess


@dataclass(frozen=True)
class MarginCurve:
    """The amplitude at a height where the beam is stiffer or softer than assumed."""

    errors: Array  # (n,) relative error of the stiffness [-]
    bare: Array  # (n,) remaining amplitude at the bare optimum [-]
    safe: Array  # (n,) and with the margin [-]
    bare_height: float  # [m]
    safe_height: float  # [m]
    price: float  # efficiency given up where the stiffness is as assumed [-]


def margin_curve(amplitude: float, count: int = 21) -> MarginCurve:
    """Compute both heights on beams whose stiffness is up to 5 % off, driven at the frequency of the one thought."""
    scene = standard_bench().with_(mass_fraction=_MASS_FRACTION)
    selector = DirectSelector(
        scene, MarginBox(stiffness=0.05, mass=0.0, frequency=0.0, restitution=0.0), deadline=_UNHURRIED
    )
    bare, safe = (selector.select(Excitation(amplitude), margin) for margin in (0.0, 1.0))
    damper = DamperResponse(scene, _RTOL)
    errors = np.linspace(-0.05, 0.05, count)

    def worst(job: tuple[float, float]) -> float:
        error, height = job
        beam = scene.beam.model_copy(update={"stiffness": (1.0 + error) * scene.beam.stiffness})
        other = DamperResponse(scene.with_(beam=beam.model_dump(), frequency=damper.frequency), _CHANGED_RTOL)
        timing = Timing(1.5 * damper.settling(), 16.0)
        amplitudes = [other.opened(amplitude, height, timing, travel).amplitude for travel in (1.0, 0.0)]
        return max(amplitudes) / damper.closed_amplitude(amplitude)

    jobs = [(float(error), height) for height in (bare.height, safe.height) for error in errors]
    found = dict(on_all_cores(worst, jobs))
    left, right = (np.array([found[(float(e), height)] for e in errors]) for height in (bare.height, safe.height))
    return MarginCurve(errors, left, right, bare.height, safe.height, safe.price)


@dataclass(frozen=True)
class PcaErrors:
    """How far the PCA is off at each amplitude of the support."""

    before: Array  # (n,) height before tuning against the best [-]
    after: Array  # (n,) height after tuning against the best [-]
    direct: Array  # (n,) height of the direct selection against the best [-]
    lost_before: Array  # (n,) beam amplitude at the height before tuning against that at the best [-]
    lost_after: Array  # (n,)
    lost_direct: Array  # (n,)


def pca_errors(amplitudes: Array, gravity: bool = True) -> PcaErrors:
    """Compute Figs 4.37 to 4.43: the best height is that of a fine scan, finer than any of the methods."""
    scene = standard_bench(gravity=9.81 if gravity else 0.0).with_(mass_fraction=_MASS_FRACTION)
    damper = DamperResponse(scene, _RTOL)
    pca, direct = PcaSelector(scene), DirectSelector(scene, workers=1)
    rows = dict(on_all_cores(lambda a: _row(damper, pca, direct, a), [float(a) for a in amplitudes]))
    columns = np.array([rows[float(a)] for a in amplitudes]).T
    return PcaErrors(*columns)


def _row(damper: DamperResponse, pca: PcaSelector, direct: DirectSelector, amplitude: float) -> list[float]:
    timing = Timing(1.5 * damper.settling(), 16.0)

    def remaining(height: float) -> float:
        return max(damper.opened(amplitude, height, timing, travel).amplitude for travel in (1.0, 0.0))

    unit = damper.ballistic_clearance(amplitude)
    scan = [
        (remaining(damper.diameter + share * unit), damper.diameter + share * unit)
        for share in np.arange(0.36, 0.95, 0.005)
    ]
    least, best = min(scan)
    chosen = pca.select(Excitation(amplitude))
    before = next(stage.height for stage in chosen.stages if stage.name == "PCA")
    heights = [before, chosen.height, direct.select(Excitation(amplitude)).height]
    return [h / best - 1.0 for h in heights] + [remaining(h) / least - 1.0 for h in heights]
