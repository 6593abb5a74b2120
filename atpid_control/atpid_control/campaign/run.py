# SPDX-License-Identifier: Apache-2.0
"""Measures the points of a campaign one after the other: set, settle, measure, check, next; pause, resume, repeat."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from atpid_common.waiting import to_stderr
from atpid_control.campaign.folder import CampaignFolder, Record
from atpid_control.campaign.judge import Judge
from atpid_control.campaign.plan import Campaign, CampaignError, Point, points_of
from atpid_control.campaign.result import measured
from atpid_control.campaign.stands import Stand
from atpid_control.runs.errors import BagError
from atpid_control.stand.errors import PlantFailedError
from atpid_sim.scene import Scene

MEASURED, SKIPPED = "measured", "skipped"
#: Called with how many points are done, and the time that the others will take by those measured now [s]; NaN: unknown.
Progress = Callable[[int, float], None]


class Pause:
    """Whether the campaign pauses: SIGUSR1 pauses it after the point being measured, and lets it go on."""

    def __init__(self) -> None:
        """Begin unpaused."""
        self.wanted = False

    @contextmanager
    def by_signal(self) -> Iterator[None]:
        """Take SIGUSR1 until the context is left."""

        def turn(_number: int, _frame: FrameType | None) -> None:
            self.wanted = not self.wanted
            to_stderr("pausing after this point; SIGUSR1 again goes on" if self.wanted else "going on")

        before = signal.signal(signal.SIGUSR1, turn)
        try:
            yield
        finally:
            signal.signal(signal.SIGUSR1, before)


class Done(NamedTuple):
    """How a campaign ended."""

    points: int
    measured: int
    skipped: list[str]  # each with its reason
    attempts_bad: int


def run_campaign(
    campaign: Campaign, scene: Scene, folder: CampaignFolder, open_stand: Callable[[Point], Stand], progress: Progress,
    pause: Pause,
) -> Done:  # fmt: skip
    """Measure the points that are not there yet; the folder is open.

    open_stand: opens the stand with a point's grain. Raises CampaignError where a person is needed and none is there,
    BenchError where the stand ends: the same campaign goes on from there.
    """
    points = points_of(campaign, scene)
    present = folder.records()
    left = [point for point in points if point.number not in present]
    stand: Stand | None = None
    grain, begun, done = -1.0, time.monotonic(), 0
    progress(len(present), float("nan"))
    try:
        for point in left:
            if stand is None or point.grain_mass != grain:
                if stand is not None:
                    stand.close()
                stand = None
                _change_grain(campaign, point, len(points))
                stand, grain = open_stand(point), point.grain_mass
            _pause(stand, pause)
            _measure(campaign, scene, stand, folder, point)
            done += 1
            folder.write_index()
            progress(len(present) + done, (len(left) - done) * (time.monotonic() - begun) / done)
    finally:
        if stand is not None:
            stand.close()
    folder.write_index()
    return summary(campaign, scene, folder)


def summary(campaign: Campaign, scene: Scene, folder: CampaignFolder) -> Done:
    """Return how far a campaign has come."""
    records = folder.records()
    skipped = [f"{record['point']}: {record['reason']}" for record in records.values() if record["status"] == SKIPPED]
    bad = sum(1 for _ in folder.bad.glob("[0-9]*"))
    return Done(len(points_of(campaign, scene)), len(records) - len(skipped), skipped, bad)


def _change_grain(campaign: Campaign, point: Point, points: int) -> None:
    """Have a person put the point's grain in; a simulated plant has it at once."""
    if campaign.stand != "real" or not (campaign.grain_masses or "none" in campaign.heights):
        return
    wanted = f"the grain of {1e3 * point.grain_mass:.4g} g" if point.grain_mass else "no grain"
    if not sys.stdin.isatty():
        raise CampaignError(f"point {point.number} of {points} needs {wanted} in the container: run it at a terminal")
    input(f"Put {wanted} into the container, close it, step back, and press Enter. ")


def _pause(stand: Stand, pause: Pause) -> None:
    if pause.wanted:
        to_stderr("paused, without excitation; SIGUSR1 goes on")
        stand.rest(lambda: not pause.wanted)


def _measure(campaign: Campaign, scene: Scene, stand: Stand, folder: CampaignFolder, point: Point) -> None:
    """Measure a point until it is good, or as often as the rules allow: then it is skipped, with the reason."""
    while True:
        part, begun = folder.begin(point.number), time.time()
        judge = Judge(campaign.rules, point.amplitude, point.frequency, point.height(scene))
        result = _attempt(stand, point, part, judge)
        record = _record(point, judge, result, begun, len(folder.attempts(point.number)) + 1)
        if not judge.bad:
            folder.keep(part, record)
            return
        to_stderr(f"point {point.text}: bad: {judge.bad}")
        if record["attempt"] > campaign.rules.repeat_bad:
            folder.keep(part, record | {"status": SKIPPED})
            return
        folder.set_aside(part, record | {"status": "bad"})
        if fault := stand.fault():
            if campaign.rules.on_fault == "end":
                raise CampaignError(f"{fault}; rules.on_fault is end: see to it, then give the same command again")
            to_stderr(f"waiting, without excitation: {fault}; see to it, then call supervisor_node/rearm")
            stand.rest(lambda: not stand.fault())


def _attempt(stand: Stand, point: Point, part: Path, judge: Judge) -> Record:
    """Measure a point once; what was bad is in the judge."""
    try:
        stand.measure(point, part, judge)
        return {} if judge.bad else measured(part, point, judge)
    except (PlantFailedError, BagError) as error:
        judge.bad = str(error)
    return {}


def _record(point: Point, judge: Judge, result: Record, begun: float, attempt: int) -> Record:
    return {
        "number": point.number, "status": MEASURED, "reason": judge.bad, "point": point.text, "attempt": attempt,
        **{f"wanted_{key}": value for key, value in asdict(point).items() if key != "number"}, **result,
        "events": judge.events, "measured_at": begun, "wall_s": time.time() - begun,
    }  # fmt: skip
