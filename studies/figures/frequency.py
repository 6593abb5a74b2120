# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A drifting and a stepping frequency followed by the loop (docs/selection.md)."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path
from atpid_control.identification import Quality
from atpid_sim.display import working
from atpid_sim.figure_style import LIGHT, WIDTH, drawn, legend_below
from atpid_sim.maps import DamperResponse
from atpid_sim.scene import load_scene
from atpid_sim.simulation.excitation import amplitude_at, frequency_at
from atpid_sim.system import Array
from studies.pure_loop import LoopRun, run_loop
from studies.seeds.measure import configured

SCENES = ("drifting_frequency", "stepping_frequency")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add this figure's arguments."""
    parser.add_argument("--out", type=file_path, default=Path("docs/figures"), help="folder the picture goes to")
    parser.add_argument("--scenes", type=file_path, default=Path("scenes"), help="folder of the scenes")


def run(args: argparse.Namespace) -> int:
    """Draw the figure; return the exit status."""
    output.folder(args.out)
    path = args.out / "selection_frequency.png"
    with working("running the loop"):
        draw([args.scenes / f"{name}.yaml" for name in SCENES], path)
    print(path)
    return 0


def draw(scenes: list[Path], path: Path) -> None:
    """Draw frequency, height and amplitude of the beam, one column a scene."""
    with drawn(path, nrows=3, ncols=len(scenes), figsize=(WIDTH, 7.6), squeeze=False) as (_, panels):
        for column, scene in enumerate(scenes):
            _draw_run(panels[:, column], run_loop(load_scene(scene), configured()), scene.stem.replace("_", " "))
        panels[0, 0].set_ylabel("frequency [Hz]")
        panels[1, 0].set_ylabel("height of the ceiling [m]")
        panels[2, 0].set_ylabel("amplitude of the beam [m]")


def _draw_run(panels: Any, run: LoopRun, title: str) -> None:
    scene, time = run.scene, np.array(run.time)
    true = np.array([frequency_at(scene, t) for t in run.time])
    steady = np.array([one.quality == Quality.STEADY for one in run.estimates])
    identified = np.where(steady, [one.frequency for one in run.estimates], np.nan)
    panels[0].plot(time, true, LIGHT.given, linewidth=3.0, label="excitation")
    panels[0].plot(time, identified, "C0.", markersize=2.0, label="identified, steady")
    panels[0].axhline(scene.natural_frequency_hz, color=LIGHT.muted, linestyle=":", label="natural frequency")
    panels[0].set_title(title)
    panels[1].plot(time, run.heights, LIGHT.own, linewidth=1.2)
    panels[2].plot(time, _closed(run, true), LIGHT.given, linewidth=1.5, label="closed damper, steady")
    panels[2].plot(time, [one.beam_amplitude for one in run.estimates], "C0", linewidth=1.0, label="beam")
    rumbling = np.where(run.rumbling, [one.beam_amplitude for one in run.estimates], np.nan)
    panels[2].plot(time, rumbling, "C1", linewidth=2.0, label="rumble")
    panels[2].set_xlabel("time [s]")
    for axes in panels:
        legend_below(axes)


def _closed(run: LoopRun, frequencies: Array) -> Array:
    """Return the steady amplitude of the closed damper at each instant (n,) [m]."""
    dampers = {f: DamperResponse(run.scene.with_(frequency=f)) for f in dict.fromkeys(map(float, frequencies))}
    amplitudes = [max(amplitude_at(run.scene, t), 1e-12) for t in run.time]
    return np.array([dampers[float(f)].closed_amplitude(a) for f, a in zip(frequencies, amplitudes, strict=True)])
