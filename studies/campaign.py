# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies campaign`: an unattended campaign on the emulated stand, with a fault a device and three kills.

Judged from the folder it leaves: every point there once, no measurement overlaps a fault, every bag whole, and the
curves beside simulation of the same points.
"""

import argparse
import json
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from std_srvs.srv import Trigger

from atpid_campaign.campaign.folder import MEASURED, CampaignFolder
from atpid_campaign.campaign.page import AGREE, agreeing, compared
from atpid_campaign.campaign.plan import points_of, read_campaign
from atpid_common.arguments import file_path, whole
from atpid_common.nodes.node_main import command_node
from atpid_control.runs.run import open_run
from atpid_control.stand.domain import own_domain
from atpid_control.stand.nodes.composition import QUIET
from atpid_control.stand.parts import program
from atpid_driver.standins.control import Control

#: Arguments of the example in the help.
EXAMPLE = "--out out/campaign --seed 1"
SCENE: dict[str, Any] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {"amplitude": 0.01, "frequency": "resonance"},
    "ceiling": {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"},
    "gravity": 9.81,
    "duration": 20.0,
    "tolerance": 1e-6,
    "sensors": {"laser": {"rate": 1000.0, "noise": 20e-6}},
    "seed": 1,
}
#: 60 points: two grains, three frequencies, five ceilings, two amplitudes.
CAMPAIGN: dict[str, Any] = {
    "scene": "scene.yaml",
    "stand": "emulated",
    "amplitudes": [0.01, 0.015],
    "frequency_ratios": [0.97, 1.0, 1.03],
    "heights": ["closed", 0.08, 0.12, 0.16, 0.2],
    "grain_masses": [0.0362, 0.06],
    "rules": {"settle_limit": 40.0, "repeat_bad": 20},
}
#: The campaign may take so long at most [s].
_LONGEST = 3600.0


@dataclass
class Injected:
    """A fault or a kill: what, and when it began and ended by the wall clock [s]."""

    what: str
    begin: float = math.nan
    end: float = math.nan

    @property
    def spoils(self) -> bool:
        """Whether a measurement during it cannot be right; one that was killed leaves none."""
        return "kill" not in self.what


class Running:
    """The campaign's process, what it prints, and its devices."""

    def __init__(self, folder: Path) -> None:
        """Start it, or let it go on."""
        command = [str(program()), "campaign", str(folder / "campaign.yaml"), "--out", str(folder / "points")]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self.lines: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append(line.rstrip())
            print(line, end="", file=sys.stderr)

    def children(self) -> dict[str, int]:
        """Return the processes of the stand, by the name of their program."""
        found: dict[str, int] = {}
        for task in Path(f"/proc/{self.process.pid}/task").glob("*/children"):
            for child in map(int, task.read_text().split()):
                words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
                names = [Path(word).name for word in words]
                found |= {name: child for name in names if name.endswith("_node")}
                found |= {"board": child} if "emulator" in names else {}
        return found

    def device(self) -> Control:
        """Return the control of the T7 stand-in."""
        values = Path(f"/proc/{self.children()['labjack_node']}/environ").read_bytes().decode().split("\0")
        return Control(next(Path(value.partition("=")[2]) for value in values if value.endswith("/device")))

    def stop_for(self, name: str, seconds: float) -> None:
        """Let a process, or what it stands for, not answer for some seconds; each leads a group of its own."""
        group = self.children()[name]
        os.killpg(group, signal.SIGSTOP)
        time.sleep(seconds)
        os.killpg(group, signal.SIGCONT)


def laser(kind: str) -> None:
    """Disturb a laser for three seconds."""
    for value in (f"['{kind} off 0 1000000']", "['']"):
        words = [str(program()), "ros", "param", "set", "/plant_node", "faults", value]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
        time.sleep(3.0)


#: One fault a device.
FAULTS: dict[str, Callable[[Running], None]] = {
    "support laser: no reading for 3 s": lambda _: laser("support_laser"),
    "beam laser: no reading for 3 s": lambda _: laser("beam_laser"),
    "T7: 500 scans lost": lambda running: running.device().drop(500),
    "motor board: no answer for 2 s": lambda running: running.stop_for("board", 2.0),
    "exciter: its process stands for 3 s": lambda running: running.stop_for("excitation_node", 3.0),
    "recorder: killed": lambda running: os.kill(running.children()["recorder_node"], signal.SIGKILL),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--out", type=file_path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument("--seed", type=whole(0, 2**31), default=1, help="seed of the instants")
    parser.add_argument("--judge", action="store_true", help="judge the folder as it is")


def run(args: argparse.Namespace) -> int:
    """Run the campaign with faults and kills, judge it, print a table; return 1 where a rule is broken."""
    folder = args.out.resolve()
    if not args.judge:
        folder.mkdir(parents=True)
        for name, values in (("scene.yaml", SCENE), ("campaign.yaml", CAMPAIGN)):
            (folder / name).write_text(yaml.safe_dump(values), encoding="utf-8")
        with own_domain() as domain:  # free now: the campaign, whenever it is started, and its faults are in it
            pass
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        injected = _run(folder, random.Random(args.seed))
        (folder / "injected.json").write_text(json.dumps([vars(one) for one in injected], indent=1))
    return _judge(folder)


def _run(folder: Path, chance: random.Random) -> list[Injected]:
    """Run it to its end; each fault and kill comes after a number of points drawn at random, and a random time."""
    whats = [*FAULTS, *(f"kill -9 of the campaign, number {number}" for number in (1, 2, 3))]
    chance.shuffle(whats)
    plan = list(zip(sorted(chance.sample(range(1, 56), len(whats))), whats, strict=True))
    done: list[Injected] = []
    running, ends = Running(folder), time.monotonic() + _LONGEST
    while time.monotonic() < ends:
        time.sleep(0.5)
        _rearm(running)
        if running.process.poll() is not None:
            if running.process.returncode == 0:
                return done
            print(f"the campaign ended with {running.process.returncode}; the same command again", file=sys.stderr)
            time.sleep(8.0)  # nodes of a killed one end by themselves
            running = Running(folder)
        points = len(list((folder / "points" / "points").glob("[0-9]*")))
        if plan and points >= plan[0][0] and "recorder_node" in running.children():
            what = plan.pop(0)[1]
            time.sleep(chance.uniform(0.0, 9.0))
            print(f"injected: {what}", file=sys.stderr)
            one = Injected(what, time.time())
            try:
                if what in FAULTS:
                    FAULTS[what](running)
                else:
                    running.process.kill()
            except (KeyError, OSError, subprocess.CalledProcessError) as error:  # gone between two points
                print(f"not injected, again later: {error!r}", file=sys.stderr)
                plan.insert(0, (points, what))
                continue
            one.end = time.time()
            done.append(one)
    running.process.terminate()
    raise SystemExit(f"not done within {_LONGEST:g} s")


def _rearm(running: Running) -> None:
    """Do what the campaign asks a person for: arm the stand again, until it measures."""
    if not running.lines or not running.lines[-1].startswith("waiting, without excitation"):
        return
    with command_node(partial(Node, "person"), *QUIET) as (node, executor):
        for drive in ("supervisor_node", "excitation_node"):
            client = node.create_client(Trigger, f"{drive}/rearm")
            if client.wait_for_service(5.0):
                answer = client.call_async(Trigger.Request())
                executor.spin_until_future_complete(answer, timeout_sec=12.0)
                print(f"rearm: {answer.result()}", file=sys.stderr)
    if running.lines[-1].startswith("waiting"):
        running.lines.append("")


def _judge(folder: Path) -> int:
    """Print what came of it; return 1 where a rule is broken or fewer than 95 % of the points agree."""
    campaign, scene = read_campaign(folder / "campaign.yaml")
    kept, points = CampaignFolder(folder / "points"), points_of(campaign, scene)
    injected = [Injected(**one) for one in json.loads((folder / "injected.json").read_text())]
    records, rows = kept.records(), compared(campaign, scene, kept)
    broken = [f"skipped: {one['point']}: {one['reason']}" for one in records.values() if one["status"] != MEASURED]
    if (numbers := sorted(one["number"] for one in records.values())) != sorted(point.number for point in points):
        broken.append(f"{len(points)} points asked for, there are {numbers}")
    columns = ("beam_amplitude", "beam_amplitude_std", "simulated_amplitude", "simulated_amplitude_std")
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in ("point", "measured [m]", "±", "simulated [m]", "±", "apart [σ]", "attempt"):
        table.add_column(name, justify="left" if name == "point" else "right")
    for row in rows:
        bag = kept.place(row["number"]) / "bag"
        start = 1e-9 * open_run(bag).start_ns  # by the wall clock [s]: samples have its stamps
        broken += [
            f"{row['point']}: measured during {one.what}"
            for one in injected
            if one.begin < start + row["end"] and start + row["begin"] < one.end and one.spoils
        ]
        broken += _verified(bag)
        values = (f"{row[name]:.5f}" for name in columns)
        table.add_row(row["point"], *values, f"{row['apart']:+.1f}", str(row["attempt"]))
    console = Console(width=130, highlight=False)
    console.print(table)
    bad = [json.loads(path.read_text()) for path in sorted(kept.bad.glob("*/point.json"))]
    for line in (*(f"injected: {one.what}" for one in injected),
                 *(f"bad: {one['point']}: {one['reason']}" for one in bad),
                 *(f"BROKEN: {line}" for line in broken)):  # fmt: skip
        console.print(line)
    share = agreeing(rows) / len(rows) if rows else 0.0
    counts = f"{len(bad)} bad attempts, {len(injected)} faults and kills"
    console.print(f"{len(rows)} of {len(points)} points measured, {counts}; within {AGREE:g} standard deviations of "
                  f"simulation: {agreeing(rows)} ({100.0 * share:.1f} %)")  # fmt: skip
    return int(bool(broken) or share < 0.95)


def _verified(bag: Path) -> list[str]:
    done = subprocess.run([str(program()), "bag", "verify", str(bag)], capture_output=True, text=True, check=False)
    return [] if done.returncode == 0 else [f"{bag}: {done.stdout.splitlines()[-1:]}{done.stderr}"]
