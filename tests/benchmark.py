# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How fast the parts that run with the stand are: the time the stand takes over the processor time they need.

`make benchmark` prints one ratio a part, all measured in one run. No test compares them with a limit: they depend on
the machine and on what else it does.
"""

import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from graph_runs import in_lockstep, scene_file

from atpid_control.identification import Identifier
from atpid_control.selection.pca import PcaSelector
from atpid_control.selection.protocol import Excitation
from atpid_sim.scene import load_scene
from studies.identification.measure import SETTINGS
from studies.load.command import measure

SCENES = Path(__file__).resolve().parent.parent / "scenes"
BLOCK, RATE = 0.05, 1000.0  # of the stand's laser [s], [1/s]


class Part(NamedTuple):
    """One part: the time on the stand's clock and the processor time spent on it [s]."""

    name: str
    real: float
    processor: float


def graph(folder: Path, seconds: float) -> Part:
    """The whole node graph in lockstep, with its bag, from the first block on."""
    marks: list[tuple[float, float]] = []
    changes = {"duration": seconds, "steady_window": [0.8 * seconds, seconds]}
    path = scene_file(SCENES / "thesis_4_3.yaml", folder, **changes)
    in_lockstep(path, folder / "run", lambda reached: marks.append((reached, time.process_time())))
    first = next(mark for mark in marks if mark[0] > 0.0)
    return Part("node graph in lockstep", marks[-1][0] - first[0], marks[-1][1] - first[1])


def estimate(seconds: float) -> Part:
    """One estimate of the excitation for each block."""
    t = np.arange(round(seconds * RATE)) / RATE
    noise = np.random.default_rng(13).normal(0.0, 1e-4, t.size)
    displacement, identifier, spent = 0.015 * np.sin(2.0 * np.pi * 5.49 * t) + noise, Identifier(SETTINGS), []
    scans = round(BLOCK * RATE)
    for first in range(0, t.size, scans):
        begun = time.thread_time()
        identifier.push(first, RATE, displacement[first : first + scans], None, t[first])
        spent.append(time.thread_time() - begun)
    return Part("estimate of one block", BLOCK, float(np.median(spent)))


def selection() -> Part:
    """One height by the predictive control algorithm with tuning."""
    selector, spent = PcaSelector(load_scene(SCENES / "standard.yaml")), []
    for amplitude in (0.01, 0.03, 0.07):
        begun = time.process_time()
        selector.select(Excitation(amplitude))
        spent.append(time.process_time() - begun)
    return Part("height by pca, in one block", BLOCK, float(np.median(spent)))


def drivers(seconds: float) -> Part:
    """Both acquisition nodes at their devices' full rates."""
    result = measure(seconds)
    return Part("both drivers at full rate", result.seconds, result.driver_cores * result.seconds)


def parts(folder: Path, seconds: float) -> list[Part]:
    """Measure each part; `seconds` is how long the stand would run."""
    selection()  # loads what is compiled
    return [graph(folder, seconds), estimate(seconds), selection(), drivers(0.5 * seconds)]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        measured = parts(Path(made), float(sys.argv[1]))
    print(f"{'part':30}{'real time [s]':>15}{'processor [s]':>15}{'ratio':>9}")
    for part in measured:
        print(f"{part.name:30}{part.real:15.3f}{part.processor:15.5f}{part.real / part.processor:9.1f}")
