# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The lockstep bench's loop without the graph: the same plant, identifier, watch and controller, called in turn."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.injected_faults import CEILING, LINK, RECORDER
from atpid_common.vocabulary import EventKind
from atpid_control.identification import Estimate, Identifier
from atpid_control.loop.protocol import HeightCommand, LoopAnswer
from atpid_control.loop.rumble import RumbleSettings, RumbleWatch
from atpid_control.loop.settings import controller_of, identification_settings, selector_of, settings_of
from atpid_control.stand.parameters import BenchError
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import Stream
from atpid_sim.scene import ControlledCeiling, Scene
from atpid_sim.system import Array

#: Parameters of identifier_node and selector_node by name.
Parameters = Mapping[str, Mapping[str, Any]]


@dataclass
class LoopRun:
    """The record of a run: one entry a block, the true beam at the laser's instants."""

    scene: Scene
    time: list[float] = field(default_factory=list)  # of the block's last scan [s]
    estimates: list[Estimate] = field(default_factory=list)
    answers: list[LoopAnswer] = field(default_factory=list)
    heights: list[float] = field(default_factory=list)  # of the ceiling at the block's last scan [m]
    rumbling: list[bool] = field(default_factory=list)  # by the watch
    blocks: list[Array] = field(default_factory=list)

    @property
    def beam(self) -> Array:
        """True displacement of the beam (n,) [m]."""
        return np.concatenate(self.blocks)

    def events(self, kind: str) -> list[tuple[float, str]]:
        """Return (time [s], text) of the events of a kind."""
        return [(t, answer.text) for t, answer in zip(self.time, self.answers, strict=True) if answer.kind == kind]


class Ceiling:
    """A ceiling of constant speed, commanded at a block's last scan: the simulated motor's rule, by stamps alone."""

    def __init__(self, height: float, limits: tuple[float, float], speed: float) -> None:
        """Stand at `height` [m]; limits [m], speed [m/s]."""
        self._limits, self.speed = limits, speed
        self._start, self._origin, self.target = 0.0, height, height

    def height(self, time: float) -> float:
        """Return where it is at `time` [s]."""
        distance = self.target - self._origin
        gone = self.speed * max(0.0, time - self._start)
        return self.target if gone >= abs(distance) else self._origin + math.copysign(gone, distance)

    def send(self, command: HeightCommand, time: float) -> None:
        """Move to the commanded height from that at `time` [s]; a height of NaN or beyond the limits is ignored."""
        goal = command.height
        if not self._limits[0] <= goal <= self._limits[1] or goal == self.target:
            return
        self._start, self._origin, self.target = time, self.height(time), goal


def run_loop(
    scene: Scene, parameters: Parameters, height_map: Path | None = None, *, model: Scene | None = None
) -> LoopRun:
    """Run a scene whose ceiling a controller moves; return what happened.

    model: the scene the controller is given, where that is not the one that runs. Raises SelectionError, HoldError
    or IdentificationError for parameters that do not fit, NumericalFailure where the plant fails.
    """
    modelled, moved = model or scene, controlled(scene)
    selecting, identifying = parameters["selector_node"], parameters["identifier_node"]
    method = controlled(modelled).controller
    selector = selector_of(selecting.__getitem__, method, modelled, height_map, lockstep=True)
    controller = controller_of(selecting.__getitem__, modelled, selector, None, None)
    identifier = Identifier(identification_settings(identifying.__getitem__))
    watch = RumbleWatch(settings_of(RumbleSettings, identifying.__getitem__, "rumble_"))
    scene.refuse_faults("a run without the graph", ("clock", *CEILING, *LINK, *RECORDER))  # none of which it has
    stream = Stream(scene, Plant(scene))
    ceiling = Ceiling(stream.height, moved.range, moved.speed)
    run, last = LoopRun(scene), 0.0
    while not stream.finished:
        reached = ceiling.height(last)
        block = stream.advance(ceiling.target, ceiling.speed if reached != ceiling.target else 0.0)
        reading = block.readings[0]
        support, beam = np.ascontiguousarray(reading.data.T)
        last = (reading.first_index + block.scans - 1) / reading.rate
        estimate = identifier.push(reading.first_index, reading.rate, support, beam, last)
        before = watch.state.rumbling
        rumbling = watch.push(reading.first_index, reading.rate, beam, estimate.frequency).rumbling
        if rumbling != before:
            controller.on_event(EventKind.RUMBLE if rumbling else EventKind.CALM)
        answer = controller.answer(last, estimate, reached)
        ceiling.send(answer.command, last)
        run.time.append(last)
        run.estimates.append(estimate)
        run.answers.append(answer)
        run.heights.append(stream.height)
        run.rumbling.append(rumbling)
        run.blocks.append(block.truth_series("beam"))
    return run


def controlled(scene: Scene) -> ControlledCeiling:
    """Return the scene's ceiling; raise BenchError where no controller moves it."""
    if not isinstance(scene.ceiling, ControlledCeiling):
        raise BenchError(f"ceiling: given {scene.ceiling.kind}; allowed: one that a `controller` moves")
    return scene.ceiling
