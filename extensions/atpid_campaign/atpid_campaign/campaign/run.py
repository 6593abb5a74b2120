# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measures the points of a campaign one after the other: set, settle, measure, check, next; pause, resume, repeat."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from itertools import pairwise
from types import FrameType
from typing import NamedTuple

from atpid_campaign.campaign.folder import BAD, MEASURED, SKIPPED, CampaignFolder, Record
from atpid_campaign.campaign.plan import Campaign, CampaignError, Point, points_of
from atpid_campaign.campaign.result import Judge, measured
from atpid_campaign.campaign.stands import Stand
from atpid_common.waiting import to_stderr
from atpid_control.runs.errors import BagError
from atpid_control.stand.parameters import PlantFailedError
from atpid_sim.scene import Scene
from atpid_sim.simulation.batch import Progress

_Paused = Callable[[], bool]
_Opener = Callable[[Point], Stand]


@contextmanager
def pause_by_signal() -> Iterator[_Paused]:
    """Yield whether the campaign pauses: SIGUSR1 pauses it after the point being measured, and lets it go on."""
    paused = False

    def turn(_number: int, _frame: FrameType | None) -> None:
        nonlocal paused
        paused = not paused
        to_stderr("pausing after this point; SIGUSR1 again goes on" if paused else "going on")

    before = signal.signal(signal.SIGUSR1, turn)
    try:
        yield lambda: paused
    finally:
        signal.signal(signal.SIGUSR1, before)


class Done(NamedTuple):
    """How a campaign ended."""

    points: int
    measured: int
    skipped: list[str]  # each with its reason
    attempts_bad: int


def run_campaign(
    campaign: Campaign, scene: Scene, folder: CampaignFolder, open_stand: _Opener, progress: Progress, paused: _Paused
) -> Done:
    """Measure the points that are not there yet; the folder is open.

    open_stand: opens the stand with a point's grain. Raises CampaignError where a person is needed and none is there,
    BenchError where the stand ends: the same campaign goes on from there.
    """
    points, present = points_of(campaign, scene), folder.records()
    left = [point for point in points if point.number not in present]
    progress(len(present))
    with ExitStack() as stack:
        for done, (before, point) in enumerate(pairwise((None, *left)), 1):
            assert point is not None
            if before is None or point.grain_mass != before.grain_mass:
                stack.close()
                _change_grain(campaign, point, len(points))
                stand = open_stand(point)
                stack.callback(stand.close)
            if paused():
                to_stderr("paused, without excitation; SIGUSR1 goes on")
                stand.rest(lambda: not paused())
            _measure(campaign, scene, stand, folder, point)
            folder.write_index()
            progress(len(present) + done)
    folder.check()
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


def _measure(campaign: Campaign, scene: Scene, stand: Stand, folder: CampaignFolder, point: Point) -> None:
    """Measure a point until it is good, or as often as the rules allow: then it is skipped, with the reason."""
    status = BAD
    while status == BAD:
        part, begun, attempt = folder.begin(point.number), time.time(), folder.attempts(point.number) + 1
        judge = Judge(campaign.rules, point.amplitude, point.frequency, point.height(scene))
        result: Record = {}
        try:
            stand.measure(point, part, judge)
            result = {} if judge.bad else measured(part, point, judge)
        except (PlantFailedError, BagError) as error:
            judge.bad = str(error)
        if judge.bad:
            to_stderr(f"point {point.text}: bad: {judge.bad}")
        status = MEASURED if not judge.bad else BAD if attempt <= campaign.rules.repeat_bad else SKIPPED
        about = {"number": point.number, "status": status, "reason": judge.bad, "point": point.text, "attempt": attempt}
        wanted = {f"wanted_{key}": value for key, value in asdict(point).items() if key != "number"}
        times = {"measured_at": begun, "wall_s": time.time() - begun}
        folder.keep(part, {**about, **wanted, **result, "events": judge.events, **times})
        if judge.bad and (fault := stand.fault()):
            if campaign.rules.on_fault == "end":
                raise CampaignError(f"{fault}; rules.on_fault is end: see to it, then give the same command again")
            to_stderr(f"waiting, without excitation: {fault}; see to it, then call supervisor_node/rearm")
            stand.rest(lambda: not stand.fault())
