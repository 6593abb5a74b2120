# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of the stability: multipliers at the best heights, the distance to the cliff, and a way across it."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from atpid_sim.figure_style import WIDTH, drawn, legend_below
from atpid_sim.maps import DamperResponse, map_tolerance
from atpid_sim.periodic import Conditions, PeriodicMotion, periodic_motion, raised
from atpid_sim.scene import Scene
from atpid_sim.simulation.fidelity import complete_fidelity
from atpid_sim.simulation.integration import Integration
from atpid_sim.system import Array
from studies.atlas.atlas import Atlas
from studies.atlas.plan import MASS
from studies.atlas.stability import FINE, settled

#: Heights of the way across the cliff, over that of the cliff; the first is stable.
_WAY = np.concatenate([np.linspace(0.955, 0.995, 21), np.linspace(0.996, 1.012, 33)])


class Way(NamedTuple):
    """A periodic motion while the ceiling is raised across its cliff."""

    heights: Array  # (n,) [m]
    multipliers: Any  # (n, 4) complex, the largest modulus first
    cliff: float  # [m]


def way_across(scene: Scene, amplitude: float, cliff: float) -> Way:
    """Return the multipliers below and above a cliff [m] of a scene's system; amplitude: of the support [m]."""
    damper = DamperResponse(scene, map_tolerance(scene))
    integration = Integration(scene, complete_fidelity(scene), FINE)
    first = Conditions(amplitude, damper.frequency, float(_WAY[0]) * cliff)
    motion = periodic_motion(integration, first, settled(damper, first)).motion
    found: list[PeriodicMotion] = []
    for share in _WAY:
        motion = None if motion is None else raised(integration, motion, float(share) * cliff)
        if motion is None:
            break
        found.append(motion)
    heights = np.array([each.conditions.height for each in found])
    return Way(heights, np.array([each.multipliers for each in found]).reshape(-1, 4), cliff)


def draw_stability(atlas: Atlas, scene: Scene, file: Path) -> None:
    """Draw multipliers and cliffs of an atlas into a file; scene: the one the atlas was made for."""
    with drawn(file, mosaic=[["left", "right"], ["below", "below"]], figsize=(WIDTH, 7.6)) as (_, panels):
        multipliers, distances, plane = panels.values()
        part = atlas.blocks[MASS]
        amplitudes = 1e3 * np.array(atlas.plan.amplitudes)
        for row, fraction in enumerate(atlas.plan.mass_fractions):
            label = f"{100 * fraction:g} % of grain"
            a_period = part["largest"][row] ** (1.0 / np.maximum(part["periods"][row], 1))
            multipliers.plot(amplitudes, a_period, ".-", linewidth=1.0, label=label)
            distance = 1e3 * (part["cliff"][row] - part["best_height"][row])
            distances.plot(amplitudes, np.where(distance > 0.0, distance, np.nan), ".-", linewidth=1.0, label=label)
        multipliers.axhline(1.0, color="black", linewidth=1.0)
        multipliers.set(xscale="log", xlabel="amplitude of the support [mm]", ylabel="largest modulus, a period [-]")
        multipliers.set(title="Multipliers at the best height", ylim=(0.3, 1.1))
        distances.set(xscale="log", yscale="log", xlabel="amplitude of the support [mm]", ylabel="distance [mm]")
        distances.set(title="From the best height to the cliff")
        for axes in (multipliers, distances):
            legend_below(axes)
            ticks = [a for a in (1, 2, 5, 10, 20, 50, 100) if amplitudes[0] <= a <= amplitudes[-1]]
            axes.set_xticks(ticks, [str(a) for a in ticks])
            axes.tick_params(axis="x", which="minor", labelbottom=False)
        _plane(plane, atlas, scene)


def _plane(axes: Any, atlas: Atlas, scene: Scene) -> None:
    """Draw the multipliers of the middle amplitude while the ceiling is raised across the cliff."""
    part = atlas.blocks[MASS]
    row = int(np.argmin(np.abs(np.array(atlas.plan.mass_fractions) - atlas.plan.slice_fraction)))
    column = len(atlas.plan.amplitudes) // 2
    amplitude, cliff = atlas.plan.amplitudes[column], float(part["cliff"][row, column])
    circle = np.exp(2j * math.pi * np.linspace(0.0, 1.0, 200))
    axes.plot(circle.real, circle.imag, color="black", linewidth=1.0)
    axes.set(aspect="equal", xlabel="real part", ylabel="imaginary part")
    title = f"Across the cliff, A = {1e3 * amplitude:.3g} mm"
    if math.isfinite(cliff):
        fraction = atlas.plan.mass_fractions[row]
        resonant = scene.with_(mass_fraction=fraction, excitation={"amplitude": amplitude, "frequency": "resonance"})
        way = way_across(resonant, amplitude, cliff)
        shown = np.repeat(1e3 * way.heights, 4)
        points = axes.scatter(way.multipliers.real.ravel(), way.multipliers.imag.ravel(), c=shown, s=14, zorder=3)
        axes.figure.colorbar(points, ax=axes, label="height [mm]", panchor=False)
        title += f", h = {1e3 * cliff:.1f} mm"
    axes.set(title=title)
