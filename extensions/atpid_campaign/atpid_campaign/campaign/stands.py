# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The role of a stand in a campaign, and the simulated one: a bench in lockstep for each point."""

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from atpid_campaign.campaign.plan import Campaign, Point, from_rest
from atpid_campaign.campaign.result import Judge
from atpid_common.files import Document
from atpid_common.vocabulary import Mode
from atpid_control.identification import Estimate
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.domain import own_domain
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import parameters_for
from atpid_sim.scene import Scene

#: Between two looks whether a rest is over [s].
_LOOK = 0.1
#: What a judge needs of an estimate, beside its time.
_MEASURED = ("quality", "amplitude", "amplitude_std", "frequency", "frequency_std", "lost", "beam_amplitude")


class Stand(ABC):
    """What a campaign asks of a stand; as it is here, of one that needs no rest, has no faults and nothing to end."""

    @abstractmethod
    def measure(self, point: Point, folder: Path, judge: Judge) -> None:
        """Set a point and show the judge each answered block until it is over; the bag is `folder`/bag.

        Raises BenchError or NodeDiedError where the stand cannot go on.
        """

    def rest(self, until: Callable[[], bool]) -> None:
        """Wait without excitation until that is true."""
        while not until():
            time.sleep(_LOOK)

    def fault(self) -> str:
        """Return what keeps the stand from being measured, latched until a person has seen to it; empty: nothing."""
        return ""

    def close(self) -> None:  # noqa: B027  # most have something to end
        """End everything in order."""


@dataclass
class Feed:
    """Gives a judge what the graph publishes."""

    judge: Judge
    recording: bool = True
    height: float = float("nan")  # of the ceiling, reported last [m]
    mode: int = Mode.UNCONFIGURED
    last: float = field(default_factory=time.monotonic)  # when the last estimate came, by the steady clock [s]

    def __call__(self, message: Any) -> None:
        """Take a message of the topics excitation, ceiling/state and events; others are left out."""
        kind = type(message).__name__
        if getattr(message, "handshake", False):
            return
        if kind == "Event":
            self.judge.on_event(message.severity, message.kind, message.text)
        elif kind == "CeilingState":
            self.height, self.mode = message.height, message.mode
            if message.mode == Mode.FAULT and not self.judge.over:
                self.judge.bad = f"the motor's fault: {message.fault}"
        elif kind == "Excitation":
            self.last, stamp = time.monotonic(), message.header.stamp
            estimate = Estimate(
                time=stamp.sec + 1e-9 * stamp.nanosec, **{name: getattr(message, name) for name in _MEASURED}
            )
            self.judge.push(estimate, self.height, self.mode == Mode.MOVING, self.recording)


class _OverError(Exception):
    """The judge needs nothing more."""


class SimulatedStand(Stand):
    """A bench in lockstep for each point, from rest: a point depends on no other."""

    def __init__(self, campaign: Campaign, scene: Scene) -> None:
        """Take the campaign; nothing is started yet."""
        self._campaign, self._scene = campaign, scene

    def measure(self, point: Point, folder: Path, judge: Judge) -> None:
        """See `Stand.measure`."""
        from atpid_control.stand.nodes.composition import run_lockstep  # needs ROS

        rules = self._campaign.rules
        duration = rules.settle_limit + rules.measure_periods / point.frequency + 1.0
        changes: Document = {"duration": duration, "steady_window": [0.5 * duration, duration]}
        if point.is_method:
            changes["ceiling"] = self._scene.to_mapping()["ceiling"] | {"controller": point.ceiling}
        changes["seed"] = 1000 * self._campaign.seed + self._scene.seed + point.number  # each has a noise of its own
        changes["mass_fraction"] = point.mass_fraction
        scene = from_rest(self._scene, point.amplitude, point.frequency, point.height(self._scene), **changes)
        file = folder / "scene.yaml"
        file.write_text(scene.to_yaml(), encoding="utf-8")
        parameters = parameters_for(scene, file, map_for(scene), folder / "bag", lockstep=True)
        parameters["recorder_node"]["files"] = [str(folder / "parameters.yaml")]
        write_parameters(parameters, folder / "parameters.yaml")
        os.environ["ROS_LOG_DIR"] = str(folder / "log")
        feed = Feed(judge)

        def progress(_time: float) -> None:
            if judge.over:
                raise _OverError

        with own_domain(), suppress(_OverError):
            run_lockstep(parameters, progress, lambda _time, message: feed(message))
        if not judge.over:
            judge.bad = f"the run ended before the point was measured: {judge.missing}"
