# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs the legs of a soak one after the other, each to a bag of its own that is checked and, if sound, removed."""

import gc
import json
import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from atpid_common.output import writing
from atpid_control.runs.errors import BagError
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.errors import BenchError
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import parameters_for, program
from atpid_control.stand.running import commands_of, run_lockstep, run_realtime, shown
from atpid_sim.scene import Scene, load_scene
from studies.soak import segments
from studies.soak.delays import Delay, delays
from studies.soak.measure import Sampler
from studies.soak.schedule import Fault, leg_mapping

#: What a bag takes: measured 46 kB for a second of the bench at 1 kHz [bytes/s], and what has to stay free [bytes].
RATE, RESERVE = 60_000, 500_000_000
#: Bags with findings that are kept; the next ones end the soak, since the disk must not fill.
KEPT = 5
#: Looks at the processes in each leg.
SAMPLES = 400


@dataclass(frozen=True)
class Plan:
    """What to run."""

    scene: Scene
    legs: Sequence[float]  # durations [s]
    seed: int
    out: Path
    real_time: bool = False
    keep: bool = False  # every bag, not only those with findings
    faults: Sequence[Fault] = ()


@dataclass
class Leg:
    """What one leg showed."""

    number: int
    duration: float  # [s]
    wall: float = 0.0  # [s]
    line: str = ""  # of the check
    findings: list[str] = field(default_factory=list)
    lost: int = 0  # scans
    bag: str = ""  # where it is kept; empty: removed
    delays: list[Delay] = field(default_factory=list)


@dataclass
class Soak:
    """What a soak showed so far."""

    plan: Plan
    sampler: Sampler
    legs: list[Leg] = field(default_factory=list)
    cleaned: int = 0  # segments of programs before, removed at the begin
    left: int = 0  # segments that no process uses at the end
    stopped: str = ""  # why it ended early

    @property
    def sound(self) -> bool:
        """Whether no leg broke a rule."""
        return not any(leg.findings for leg in self.legs)


def run(plan: Plan, done: Callable[[Leg], None]) -> Soak:
    """Run all legs; `done` is called after each. A leg that ends early ends the soak, with the reason in `stopped`.

    KeyboardInterrupt ends it in the same way: the nodes have ended, the bag is closed.
    """
    sampler = Sampler(max(1.0, max(plan.legs) / SAMPLES) if max(plan.legs) > 60.0 else max(plan.legs) / 60.0)
    soak = Soak(plan, sampler, cleaned=segments.clean())
    try:
        for number, duration in enumerate(plan.legs):
            _room(plan, duration)
            leg = Leg(number, duration)
            soak.legs.append(leg)
            _run_leg(plan, leg, sampler)
            done(leg)
            if sum(bool(one.bag) and bool(one.findings) for one in soak.legs) >= KEPT and not plan.keep:
                raise BenchError(f"{KEPT} legs broke a rule; their bags are kept, the rest of the soak is left out")
    except KeyboardInterrupt:
        soak.stopped = "stopped by Ctrl-C or a signal"
    except (BenchError, BagError) as error:
        soak.stopped = str(error)
    soak.left = len(segments.orphans(age=0.0).keys() & sampler.segments)
    return soak


def _room(plan: Plan, duration: float) -> None:
    """Raise BenchError where the disk has no room for a leg."""
    needed, free = round(RATE * duration) + RESERVE, shutil.disk_usage(plan.out).free
    if free < needed:
        raise BenchError(
            f"{plan.out}: {free / 1e9:.1f} GB free, a leg of {duration:g} s needs {needed / 1e9:.1f} GB; free some "
            "space, choose another --out or a shorter --leg"
        )


def _run_leg(plan: Plan, leg: Leg, sampler: Sampler) -> None:
    folder = plan.out / f"leg-{leg.number + 1:04d}"
    scene_file, bag, logs = folder / "scene.yaml", folder / "bag", folder / "log"
    with writing(folder):
        logs.mkdir(parents=True)
        mapping = leg_mapping(plan.scene, leg.duration, plan.seed, leg.number, plan.faults)
        scene_file.write_text(yaml.safe_dump(mapping, sort_keys=False), encoding="utf-8")
    scene = load_scene(scene_file)
    height_map = map_for(scene)
    parameters = parameters_for(scene, scene_file, height_map, bag, lockstep=not plan.real_time)
    parameter_file = folder / "parameters.yaml"
    parameters["recorder_node"]["files"] = [str(parameter_file), *([str(height_map)] if height_map else [])]
    with writing(parameter_file):
        write_parameters(parameters, parameter_file)
    os.environ["ROS_LOG_DIR"] = str(logs)
    sampler.begin(leg.number)
    label = f"leg {leg.number + 1} of {len(plan.legs)}"
    with own_domain() as _, shown(scene.duration, label) as progress:
        following = sampler.following(progress)
        if plan.real_time:
            run_realtime(commands_of(parameter_file), logs, following, faults=scene.injected)
        else:
            run_lockstep(parameters, following)
            # nodes stand in cycles, and keep the middleware's threads, sockets and shared memory until those are found
            gc.collect()
    taken = [sample.wall for sample in sampler.samples if sample.leg == leg.number]
    leg.wall = taken[-1] - taken[0] if taken else 0.0
    _judge(plan, leg, bag)


def _judge(plan: Plan, leg: Leg, bag: Path) -> None:
    """Check the bag, in a process of its own so that this one's memory is the run's, and keep it where it has to be."""
    done = subprocess.run(
        [str(program()), "bag", "check", str(bag)],
        capture_output=True, text=True, check=False, start_new_session=True,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    if done.returncode not in (0, 1) or not lines:
        raise BenchError(f"{bag}: cannot be checked: {(done.stderr.strip().splitlines() or ['no answer'])[-1]}")
    leg.line = lines[-1]
    leg.findings = [line for line in lines[:-1] if not line.startswith("reported: ")]
    leg.lost = lost_of(leg.line)
    leg.delays = list(delays(bag)) if plan.real_time else []
    if leg.findings or plan.keep:
        leg.bag = str(bag)
    else:
        shutil.rmtree(bag)


def lost_of(line: str) -> int:
    """Return the scans lost, from the line of a check."""
    words = line.split(" lost;", 1)[0].split()
    return int(words[-1])


def results(soak: Soak, trends: Iterator[object] | Sequence[object]) -> dict[str, object]:
    """Return what is written to soak.json."""
    plan = soak.plan
    return {
        "seed": plan.seed,
        "mode": "real time" if plan.real_time else "lockstep",
        "hours": sum(leg.duration for leg in soak.legs) / 3600.0,
        "stopped": soak.stopped,
        "segments_cleaned": soak.cleaned,
        "segments_left": soak.left,
        "lost_scans": sum(leg.lost for leg in soak.legs),
        "findings": dict(Counter(line.split(":", 1)[0] for leg in soak.legs for line in leg.findings)),
        "trends": list(trends),
        "legs": [
            {"duration": leg.duration, "wall": leg.wall, "lost": leg.lost, "check": leg.line, "findings": leg.findings,
             "bag": leg.bag} for leg in soak.legs
        ],
    }  # fmt: skip


def write(content: dict[str, object], path: Path) -> None:
    """Write it; NaN as null."""
    with writing(path):
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
