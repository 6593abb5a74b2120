# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control seeds SCENE.yaml ...`: the loop without the graph, with many noises; how well, how calm."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from atpid_control.bench.errors import BenchError
from atpid_control.bench.graph import PARTS
from atpid_control.bench.maps import amplitudes_of, map_for
from atpid_control.bench.pure_loop import LoopRun, controlled, run_loop
from atpid_control.bench.rumbling import longest_rumble
from atpid_sim.batch import cores
from atpid_sim.display import counting
from atpid_sim.excitation import amplitude_points
from atpid_sim.maps import DamperResponse, HeightMap
from atpid_sim.scene import Scene, load_scene

#: The end of a stage in which it is measured, as the bench's summary does [s].
WINDOW = 2.0

Parameters = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Stage:
    """One interval of constant excitation in one run."""

    t0: float  # [s]
    t1: float  # [s]
    excitation_amplitude: float  # true [m]
    identified_amplitude: float  # mean of the estimates in the last 2 s [m]
    height: float  # of the ceiling at the end [m]
    amplitude: float  # half peak-to-peak of the true beam in the last 2 s [m]
    efficiency: float  # 1 - amplitude / closed damper's [-]
    rumble: float  # longest stretch [s]


@dataclass(frozen=True)
class SeedRun:
    """One run: its stages and what the controller said."""

    scene: str
    seed: int
    stages: tuple[Stage, ...]
    step_backs: int
    drifts: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE", help="scenes whose ceiling a controller moves")
    parser.add_argument("--seeds", type=int, default=50, help="runs of each scene, each with a noise of its own")
    parser.add_argument(
        "--decibels", type=float, help="signal to noise at the smallest amplitude [dB]; default: the scene's noise"
    )
    parser.add_argument(
        "--margin", type=float, help="standard deviations the height is safe for; default: selector.yaml"
    )
    parser.add_argument("--json", action="store_true", help="print every run as JSON instead of the table")


def run(args: argparse.Namespace) -> int:
    """Run all scenes with all seeds; print one row a stage."""
    if args.seeds < 1:
        raise BenchError(f"--seeds: given {args.seeds}; allowed: at least 1")
    parameters = configured()
    if args.margin is not None:
        parameters["selector_node"]["margin"] = args.margin
    done = []
    with counting("runs", len(args.scenes) * args.seeds) as count:
        for one in run_all(args.scenes, range(1, args.seeds + 1), parameters, args.decibels):
            done.append(one)
            count(len(done))
    if args.json:
        print(json.dumps([asdict(one) for one in done]))
    else:
        Console(width=110, highlight=False).print(table(done))
    return 0


def configured() -> Parameters:
    """Return the parameters of identifier and selector as their parameter files have them."""
    return {part.name: part.configured() for part in PARTS if part.name in ("identifier_node", "selector_node")}


def run_all(
    scenes: Iterable[Path], seeds: Iterable[int], parameters: Parameters, decibels: float | None = None
) -> Iterator[SeedRun]:
    """Yield every run, scene by scene, on all cores. Raises what `run_loop` does, BenchError for an unfit scene."""
    jobs = []
    for path in scenes:
        scene = load_scene(path)
        # the map is the measure of rumble whatever method selects; made here, once, where there is none
        ceiling = controlled(scene).model_dump(mode="json", exclude_none=True)
        height_map = map_for(scene.with_(ceiling=ceiling | {"controller": "lookup"}))
        assert height_map is not None
        jobs += [(path, seed, parameters, decibels, height_map) for seed in seeds]
    # threads started before a fork would be copied half alive
    with ProcessPoolExecutor(min(cores(), len(jobs)), get_context("spawn")) as pool:
        yield from pool.map(_one, jobs)


def run_seed(
    path: Path, seed: int, parameters: Mapping[str, Mapping[str, Any]], decibels: float | None, height_map: Path
) -> SeedRun:
    """Run one scene with one seed and return what is to be said of it."""
    scene = noisy(load_scene(path), seed, decibels)
    used = height_map if controlled(scene).controller == "lookup" else None
    ran = run_loop(scene, parameters, used)
    stages = tuple(measured(ran, HeightMap.load(height_map)))
    return SeedRun(path.stem, seed, stages, len(ran.said("step_back")), len(ran.said("drift")))


def _one(job: tuple[Path, int, Parameters, float | None, Path]) -> SeedRun:
    return run_seed(*job)


def noisy(scene: Scene, seed: int, decibels: float | None) -> Scene:
    """Return the scene with another seed and, where given, the laser's noise so far below its smallest amplitude."""
    if decibels is None:
        return scene.with_(seed=seed)
    noise = amplitudes_of(scene)[0] * math.sqrt(0.5) * 10.0 ** (-decibels / 20.0)
    sensors = scene.sensors.model_dump(mode="json")
    sensors["laser"]["noise"] = noise
    return scene.with_(seed=seed, sensors=sensors)


def measured(ran: LoopRun, height_map: HeightMap) -> Iterator[Stage]:
    """Yield the stages of a run."""
    scene, rate = ran.scene, ran.scene.sensors.laser.rate
    damper, fraction, beam = DamperResponse(scene, 1e-5), scene.grain.mass_fraction, ran.beam
    points = amplitude_points(scene)
    for (t0, a0), (end, a1) in pairwise([*points, (scene.duration, points[-1][1])]):
        t1 = min(end, scene.duration)
        if a0 != a1 or a0 <= 0.0 or t1 <= t0:
            continue
        window = [k for k, t in enumerate(ran.time) if t1 - WINDOW < t <= t1]
        amplitude = float(0.5 * np.ptp(beam[round((t1 - WINDOW) * rate) : round(t1 * rate)]))
        yield Stage(
            t0=t0,
            t1=t1,
            excitation_amplitude=a0,
            identified_amplitude=float(np.mean([ran.estimates[k].amplitude for k in window])),
            height=ran.heights[window[-1]],
            amplitude=amplitude,
            efficiency=1.0 - amplitude / damper.closed_amplitude(a0),
            rumble=longest_rumble(ran, (t0, t1), height_map.lookup(a0, fraction)),
        )


def table(done: list[SeedRun]) -> Table:
    """Return one row a stage: the worst and the mean of all seeds."""
    result = Table(box=SIMPLE_HEAD, pad_edge=False, title="over all seeds", title_justify="left")
    result.add_column("scene")
    for name in (
        "A [m]",
        "seeds",
        "height [m]",
        "efficiency [%]\nmean",
        "\nworst",
        "longest\nrumble [s]",
        "step\nbacks",
        "drifts",
    ):
        result.add_column(name, justify="right", no_wrap=True)
    for scene in dict.fromkeys(one.scene for one in done):
        runs = [one for one in done if one.scene == scene]
        said = str(sum(one.step_backs for one in runs)), str(sum(one.drifts for one in runs))
        for row, stages in enumerate(zip(*(one.stages for one in runs), strict=True)):
            heights, gains = [s.height for s in stages], [100.0 * s.efficiency for s in stages]
            result.add_row(
                scene if row == 0 else "", f"{stages[0].excitation_amplitude:g}", str(len(stages)),
                f"{min(heights):.4f}-{max(heights):.4f}", f"{np.mean(gains):.2f}", f"{min(gains):.2f}",
                f"{max(s.rumble for s in stages):.2f}", *(said if row == 0 else ("", "")),
            )  # fmt: skip
    return result
