# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays: what was measured, estimated, commanded and done, on the run's own time axis."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_control.bags.errors import BagError
from atpid_control.bags.read import Bag, open_bag, stamp_of
from atpid_sim.scene import Scene, SceneError, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.excitation import amplitude_at

Array = NDArray[np.float64]
STEADY = 1  # Excitation.STEADY


@dataclass(frozen=True)
class Motion:
    """Displacements sampled together."""

    time: Array  # (n,) since the first sample [s]
    support: Array  # (n,) [m]; NaN where not measured
    beam: Array  # (n,) [m]
    grain: Array  # (n,) [m]; NaN where unknown
    ceiling: Array  # (n,) height [m]; NaN where unknown


@dataclass(frozen=True)
class Estimates:
    """The identified excitation, one value a block."""

    time: Array  # (k,) [s]
    steady: NDArray[np.bool_]  # (k,)
    amplitude: Array  # (k,) [m]
    amplitude_std: Array  # (k,) [m]
    frequency: Array  # (k,) [Hz]


@dataclass(frozen=True)
class Ceiling:
    """Where the ceiling was sent and where it was."""

    commanded_time: Array  # (k,) [s]
    commanded: Array  # (k,) height [m]; NaN: stay
    time: Array  # (j,) [s]
    height: Array  # (j,) [m]


@dataclass(frozen=True)
class Ledger:
    """Energy since the start, at the end of the run [J]."""

    input: float
    ceiling_work: float
    beam_loss: float
    contact_loss: float
    stored: float
    impacts: int

    @property
    def residual(self) -> float:
        """The imbalance, relative to the energy supplied and stored at the start [-]."""
        supplied = abs(self.input) + abs(self.ceiling_work) + max(0.0, -self.stored)
        left = self.input + self.ceiling_work - self.beam_loss - self.contact_loss - self.stored
        return abs(left) / supplied if supplied else 0.0


@dataclass(frozen=True)
class RunEvent:
    """One event."""

    time: float  # [s]
    severity: int  # 0 info, 1 warning, 2 alarm
    kind: str
    source: str  # the node
    text: str
    count: int = 1  # how many times in a row


@dataclass(frozen=True)
class Run:
    """The data of a bag that a report shows."""

    bag: Bag
    scene: Scene | None
    scene_problem: str  # why there is no scene, empty where there is one
    motion: Motion
    simulated: bool  # the motion is the plant's own truth, not a sensor's reading
    estimates: Estimates
    ceiling: Ceiling
    ledger: Ledger | None
    events: list[RunEvent] = field(default_factory=list)
    blocks: int = 0  # sensor blocks
    lost: int = 0  # scans missing between them

    @property
    def duration(self) -> float:
        """Length of the motion, to the end of its last sample's interval [s]."""
        time = self.motion.time
        return float(time[-1] + (np.median(np.diff(time)) if len(time) > 1 else 0.0))

    def true_amplitude(self) -> Array | None:
        """Return the excitation's true amplitude (n,) [m] at the motion's times, None where it is unknown."""
        if self.scene is None or self.scene.excitation.kind in ("free", "series"):
            return None
        return np.array([amplitude_at(self.scene, float(t)) for t in self.motion.time])


def read_run(source: Path | Bag) -> Run:
    """Return the run in a bag; raise BagError where it has no block of displacements."""
    bag = source if isinstance(source, Bag) else open_bag(source)
    laser = _laser(bag)
    start = laser.start_ns
    truth = [
        message for topic in bag.topics_of("PlantTruth") for _, message in bag.messages(topic) if len(message.beam)
    ]
    scene, problem = _scene(bag)
    return Run(
        bag=bag,
        scene=scene,
        scene_problem=problem,
        motion=_true_motion(truth) if truth else laser.motion,
        simulated=bool(truth),
        estimates=_estimates(bag, start),
        ceiling=_ceiling(bag, start),
        ledger=_ledger(truth[-1]) if truth else None,
        events=_events(bag, start),
        blocks=laser.blocks,
        lost=laser.lost,
    )


@dataclass(frozen=True)
class _Laser:
    motion: Motion
    start_ns: int
    blocks: int
    lost: int


def _laser(bag: Bag) -> _Laser:
    for topic in bag.topics_of("SampleBlock"):
        blocks = [message for _, message in bag.messages(topic) if len(message.data)]
        if blocks and "beam_displacement" in blocks[0].channels:
            return _joined(blocks)
    raise BagError(f"{bag.path}: no samples of beam_displacement in this bag, so there is nothing to report on")


def _joined(blocks: list[Any]) -> _Laser:
    first = blocks[0]
    index = np.concatenate([b.first_index + np.arange(len(b.data) // len(b.channels)) for b in blocks])
    data = np.concatenate([np.asarray(b.data, dtype=float).reshape(-1, len(b.channels)) for b in blocks])
    names = list(first.channels)
    nothing = np.full(len(index), np.nan)
    support = data[:, names.index("support_displacement")] if "support_displacement" in names else nothing
    time = (index - first.first_index) / first.rate
    motion = Motion(time, support, data[:, names.index("beam_displacement")], nothing, nothing)
    lost = int(index[-1] - index[0] + 1 - len(index))
    start = stamp_of(first)
    return _Laser(motion, start, len(blocks), lost)


def _true_motion(truth: list[Any]) -> Motion:
    first = truth[0]
    index = np.concatenate([t.first_index + np.arange(len(t.beam)) for t in truth])
    series = [
        np.concatenate([np.asarray(getattr(t, name)) for t in truth])
        for name in ("support", "beam", "grain", "ceiling")
    ]
    return Motion((index - first.first_index) / first.rate, *series)


def _ledger(truth: Any) -> Ledger:
    return Ledger(
        truth.input_energy,
        truth.ceiling_work,
        truth.beam_loss,
        truth.contact_loss,
        truth.stored_energy,
        int(truth.impacts),
    )


def _estimates(bag: Bag, start: int) -> Estimates:
    found = [message for topic in bag.topics_of("Excitation") for _, message in bag.messages(topic)]
    values = np.array(
        [(_seconds(m, start), m.quality, m.amplitude, m.amplitude_std, m.frequency) for m in found], dtype=float
    ).reshape(-1, 5)
    return Estimates(values[:, 0], values[:, 1] == STEADY, values[:, 2], values[:, 3], values[:, 4])


def _ceiling(bag: Bag, start: int) -> Ceiling:
    commands, states = (
        np.array(
            [(_seconds(m, start), m.height) for topic in bag.topics_of(kind) for _, m in bag.messages(topic)],
            dtype=float,
        ).reshape(-1, 2)
        for kind in ("CeilingCommand", "CeilingState")
    )
    return Ceiling(commands[:, 0], commands[:, 1], states[:, 0], states[:, 1])


def _events(bag: Bag, start: int) -> list[RunEvent]:
    """Return the events; consecutive equal ones are one."""
    events: list[RunEvent] = []
    for topic in bag.topics_of("Event"):
        for _, m in bag.messages(topic):
            new = RunEvent(_seconds(m, start), int(m.severity), m.kind, m.header.frame_id, m.text)
            if events and (events[-1].kind, events[-1].text) == (new.kind, new.text):
                last = events.pop()
                new = RunEvent(last.time, last.severity, last.kind, last.source, last.text, last.count + 1)
            events.append(new)
    return events


def _scene(bag: Bag) -> tuple[Scene | None, str]:
    text = bag.scene_text
    if text is None:
        return None, "no scene was recorded"
    try:
        return scene_from_mapping(read_yaml(text, "recorded scene"), source="recorded scene", folder=bag.path), ""
    except SceneError as error:
        return None, str(error)


def _seconds(message: Any, start: int) -> float:
    return (stamp_of(message) - start) * 1e-9
