# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays: what was measured, estimated, commanded and done, on the run's own time axis."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atpid_control.bags.errors import BagError
from atpid_control.bags.read import Bag, open_bag, scans_of, stamp_of
from atpid_sim.scene import Scene, SceneError, SweepExcitation, scene_from_mapping
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation.excitation import amplitude_points
from atpid_sim.system import Array

STEADY = 1  # Excitation.STEADY
#: How far outside the run a stamp of it may be [s]: estimates come late, heights early.
_ASIDE = 60.0
#: Fields of PlantTruth in the order of `Ledger`.
_LEDGER = ("input_energy", "ceiling_work", "beam_loss", "contact_loss", "stored_energy", "impacts")


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
    left_out: tuple[str, ...] = ()  # messages that cannot be used: topic, how many, why the first

    @property
    def duration(self) -> float:
        """Length of the motion, to the end of its last sample's interval [s]."""
        time = self.motion.time
        return float(time[-1] + (np.median(np.diff(time)) if len(time) > 1 else 0.0))

    def true_amplitude(self) -> Array | None:
        """Return the excitation's true amplitude (n,) [m] at the motion's times, None where it is unknown."""
        if self.scene is None or self.scene.excitation.kind in ("free", "series"):
            return None
        points = amplitude_points(self.scene)
        if isinstance(self.scene.excitation, SweepExcitation):
            points = [(0.0, self.scene.excitation.sweep.amplitude)]
        return np.interp(self.motion.time, [t for t, _ in points], [amplitude for _, amplitude in points])


def read_run(source: Path | Bag) -> Run:
    """Return the run in a bag, of one that is cut off what is there; raise BagError where it has no displacements."""
    bag = source if isinstance(source, Bag) else open_bag(source, torn_ok=True)
    blocks = _laser_blocks(bag)
    motion, start = _measured_motion(blocks), stamp_of(blocks[0])
    end = float(motion.time[-1])
    truth = [block for topic in bag.topics_of("PlantTruth")[:1] for block in bag.stream(topic)]
    scene, problem = _scene(bag)
    time, quality, amplitude, amplitude_std, frequency = _columns(
        bag, start, end, "Excitation", "quality", "amplitude", "amplitude_std", "frequency"
    )
    return Run(
        bag=bag,
        scene=scene,
        scene_problem=problem,
        motion=_true_motion(truth) if truth else motion,
        simulated=bool(truth),
        estimates=Estimates(time, quality == STEADY, amplitude, amplitude_std, frequency),
        ceiling=Ceiling(
            *_columns(bag, start, end, "CeilingCommand", "height"), *_columns(bag, start, end, "CeilingState", "height")
        ),
        ledger=Ledger(*(getattr(truth[-1], name) for name in _LEDGER)) if truth else None,
        events=_events(bag, start, end),
        blocks=len(blocks),
        lost=int(blocks[-1].first_index)
        + scans_of(blocks[-1])
        - int(blocks[0].first_index)
        - sum(map(scans_of, blocks)),
        left_out=tuple(_left_out(bag)),
    )


def _laser_blocks(bag: Bag) -> list[Any]:
    for topic in bag.topics_of("SampleBlock"):
        blocks = list(bag.stream(topic))
        if blocks and "beam_displacement" in blocks[0].channels:
            return blocks
    raise BagError(f"{bag.path}: no samples of beam_displacement in this bag, so there is nothing to report on")


def _measured_motion(blocks: list[Any]) -> Motion:
    first, names = blocks[0], list(blocks[0].channels)
    index = np.concatenate([b.first_index + np.arange(scans_of(b)) for b in blocks])
    data = np.concatenate([np.asarray(b.data, dtype=float).reshape(-1, len(b.channels)) for b in blocks])
    nothing = np.full(len(index), np.nan)
    support = data[:, names.index("support_displacement")] if "support_displacement" in names else nothing
    time = (index - first.first_index) / first.rate
    return Motion(time, support, data[:, names.index("beam_displacement")], nothing, nothing)


def _true_motion(truth: list[Any]) -> Motion:
    first = truth[0]
    index = np.concatenate([t.first_index + np.arange(len(t.beam)) for t in truth])
    series = [
        np.concatenate([np.asarray(getattr(t, name)) for t in truth])
        for name in ("support", "beam", "grain", "ceiling")
    ]
    return Motion((index - first.first_index) / first.rate, *series)


def _columns(bag: Bag, start: int, end: float, kind: str, *names: str) -> Array:
    """Return (1 + len(names), k): the messages' times since the start [s], and these fields of theirs, NaN: no number.

    Stamps far outside the run, which ends at `end` [s], belong to none of its samples.
    """
    rows = [(_seconds(m, start), *(getattr(m, name) for name in names)) for _, m in bag.of_kind(kind)]
    table = np.array(rows, dtype=float).reshape(-1, 1 + len(names))
    table[np.isinf(table)] = np.nan
    return np.asarray(table[_of_the_run(table[:, 0], end)].T)


def _of_the_run(times: Any, end: float) -> Any:
    return (times >= -_ASIDE) & (times <= end + _ASIDE)


def _events(bag: Bag, start: int, end: float) -> list[RunEvent]:
    """Return the events; consecutive equal ones are one."""
    events: list[RunEvent] = []
    for _, m in bag.of_kind("Event"):
        if not _of_the_run(_seconds(m, start), end):
            continue
        if events and (events[-1].kind, events[-1].text) == (m.kind, m.text):
            events[-1] = replace(events[-1], count=events[-1].count + 1)
        else:
            events.append(RunEvent(_seconds(m, start), int(m.severity), m.kind, m.header.frame_id, m.text))
    return events


def _left_out(bag: Bag) -> Iterator[str]:
    """Yield a line for each topic with messages that cannot be used."""
    for topic, reasons in sorted(bag.left_out.items()):
        yield f"{topic}: {len(reasons)}, the first since {next(iter(reasons.values()))}"


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
