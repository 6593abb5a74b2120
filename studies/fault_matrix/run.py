# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""One run of the fault matrix: the scene with a fault through the graph in lockstep, beside the same without it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from atpid_common.injected_faults import CEILING, KINDS, LOCKSTEP, TO_THE_SWITCH, Injected
from atpid_common.vocabulary import EventKind
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import Bag, open_bag
from atpid_control.runs.verify import verify
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.nodes.composition import run_lockstep
from atpid_control.stand.parameters import BenchError
from atpid_control.stand.parts import parameters_for
from atpid_sim.scene import Scene
from atpid_sim.scene.scene import scene_from_mapping
from atpid_sim.simulation.quantities import half_peak_to_peak

#: The run: the excitation falls at 7 s, while a fault from 4 to 9 s is there.
SCENE: dict[str, Any] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {
        "amplitude": [[0.0, 0.0], [0.2, 0.03], [7.0, 0.03], [7.2, 0.02], [20.0, 0.02]],
        "frequency": "resonance",
    },
    "ceiling": {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"},
    "gravity": 9.81,
    "duration": 12.0,
    "tolerance": 1e-6,
    "sensors": {"laser": {"rate": 1000.0, "noise": 20e-6}, "accelerometer": {"rate": 1000.0, "noise": 0.01}},
    "seed": 1,
}
BEGIN, END = 4.0, 9.0
#: How long after a fault's end a person arms the motor again [s].
REARM = 0.5
_ROUNDING = 1e-6
#: Heights that differ by less are the same, as a selection from another estimate gives them [-].
SAME_HEIGHT = 0.02
#: Part of the matrix and its stream: topic and channel.
STREAMS = {
    "support_laser": ("/sensors/laser", "support_displacement"),
    "beam_laser": ("/sensors/laser", "beam_displacement"),
    "accelerometer": ("/sensors/accelerometer", "beam_acceleration"),
}
#: Kinds of event that report a fault; a drift reports that beam and model differ.
DETECTING = (EventKind.FAULT, EventKind.DRIFT, EventKind.DROPPED, EventKind.STALE, EventKind.FAILED)


@dataclass(frozen=True)
class Seen:
    """An event, and when it came on the plant's own time [s]."""

    time: float
    severity: int
    kind: str
    text: str


@dataclass(frozen=True)
class Finished:
    """What one run left behind."""

    events: tuple[Seen, ...]
    streams: dict[str, Any]  # of each part (`STREAMS`) its readings (n,)
    stamps: Any  # of the laser's blocks (n,) [ns]
    commands: Any  # (n, 2): time on the plant's own clock [s], height [m], NaN: stay
    states: Any  # (n, 4): time on the plant's own clock [s], height [m], mode, bits of the faults
    ceiling: Any  # true height (n,) [m]
    beam: Any  # true displacement (n,) [m]
    rate: float  # of ceiling and beam [Hz]
    answered: tuple[int, int, int]  # blocks, estimates, commands
    messages: int  # in the bag
    whole: bool  # the bag verifies and its index has no gap
    error: str  # how the run ended early, one sentence; empty: it did not

    def amplitude(self, begin: float, end: float) -> float:
        """Return half the peak-to-peak of the beam between two times [s]."""
        part = self.beam[round(begin * self.rate) : round(end * self.rate)]
        return half_peak_to_peak(part)


@dataclass(frozen=True)
class Row:
    """One fault of the matrix and what it did."""

    part: str
    kind: str
    felt: bool  # what the part gives differs from the run without the fault, and only from its begin on
    detected: Seen | None
    recovered: Seen | None
    recovery: float  # when the commanded height is that of the run without the fault again, after its end [s]
    low: float  # of the ceiling [m]
    high: float
    fastest: float  # of the ceiling [m/s]
    amplitude: float  # largest of the beam while the fault is there, over that without it [-]
    moved: float  # largest difference of the commanded height while the fault is there [m]
    whole: bool
    complete: bool  # each block answered by one estimate and one command
    error: str


def scene_with(faults: tuple[Injected, ...], folder: Path, name: str) -> tuple[Scene, Path]:
    """Return the matrix's scene with `faults`, and the file in `folder` it is written to."""
    mapping = dict(SCENE)
    if faults:
        mapping["faults"] = [{"part": fault.part, "kind": fault.kind, "from": fault.begin, "to": fault.end}
                             | ({} if math.isnan(fault.value) else {"value": fault.value})
                             for fault in faults]  # fmt: skip
    scene = scene_from_mapping(mapping, source=name)
    file = folder / f"{name}.yaml"
    file.write_text(scene.to_yaml(), encoding="utf-8")
    return scene, file


def rows() -> list[tuple[str, str]]:
    """Return the 42 rows: part and kind."""
    return [(part, kind) for part in LOCKSTEP for kind in KINDS]


def reference_of(part: str) -> tuple[Injected, ...]:
    """Return the faults of the run a part's faults are compared with: none before its last block."""
    if part not in CEILING:
        return ()
    # with the same simulated ceiling, whose heights differ by rounding from those of the one without faults; a motor
    # that is slow for an instant while it stands raises no event
    return (Injected("motor", "slow", SCENE["duration"] - 0.01, SCENE["duration"]),)


def run(faults: tuple[Injected, ...], folder: Path, name: str) -> Finished:
    """Run the matrix's scene with `faults`; bag and scene stay in `folder`. Raises AtpidError of bad input."""
    scene, file = scene_with(faults, folder, name)
    followed = _Followed()
    error = ""
    rearm: list[tuple[float, str]] = []
    if any(fault.part in CEILING for fault in faults):
        # by a person, when the causes are gone; the simulated motor fails by the stamps, so their clock counts too
        ended = max(fault.end for fault in faults if fault.part in (*CEILING, "clock"))
        rearm = [(ended + REARM, "motor_node/rearm")]
    try:
        parameters = parameters_for(scene, file, map_for(scene), folder / name, lockstep=True)
        run_lockstep(parameters, lambda _: None, followed.take, rearm)
    except BenchError as failure:
        error = str(failure)
    return _read(folder / name, followed, error)


class _Followed:
    """Messages and the plant's own time [s] at which they came; the stamps may be those of a faulty clock."""

    def __init__(self) -> None:
        self.events: list[Seen] = []
        self.commands: list[tuple[float, float]] = []
        self.states: list[tuple[float, float, int, int]] = []

    def take(self, time: float, message: Any) -> None:
        if message.handshake:
            return
        if hasattr(message, "severity"):
            self.events.append(Seen(time, int(message.severity), str(message.kind), str(message.text)))
        elif hasattr(message, "mode"):
            self.states.append((time, float(message.height), int(message.mode), int(message.faults)))
        elif hasattr(message, "height"):
            self.commands.append((time, float(message.height)))


def _read(path: Path, followed: _Followed, error: str) -> Finished:
    bag = open_bag(path)
    truth, laser = (_by_index(bag, topic) for topic in ("/plant/truth", "/sensors/laser"))
    ends = [int(block.first_index) + len(block.data) // len(block.channels) for block in laser]
    gapless = all(end == int(block.first_index) for end, block in zip(ends[:-1], laser[1:], strict=True))
    estimates, commands = (sum(1 for _ in bag.messages(name)) for name in ("/excitation", "/ceiling/command"))
    try:
        messages, whole = verify(path).messages, gapless
    except BagError:
        messages, whole = 0, False
    return Finished(
        events=tuple(followed.events),
        streams={part: _channel(bag, *place) for part, place in STREAMS.items()},
        stamps=np.array([block.header.stamp.sec * 10**9 + block.header.stamp.nanosec for block in laser]),
        commands=np.array(followed.commands),
        states=np.array(followed.states),
        ceiling=np.concatenate([message.ceiling for message in truth]),
        beam=np.concatenate([message.beam for message in truth]),
        rate=float(truth[0].rate),
        answered=(len(laser), estimates, commands),
        messages=messages,
        whole=whole,
        error=error,
    )


def _by_index(bag: Bag, topic: str) -> list[Any]:
    """Return the messages of a topic in the order of their samples, whatever their stamps."""
    return sorted((message for _, message in bag.messages(topic)), key=lambda message: int(message.first_index))


def _channel(bag: Bag, topic: str, channel: str) -> Any:
    blocks = _by_index(bag, topic)
    return np.concatenate([
        np.asarray(block.data).reshape(-1, len(block.channels))[:, list(block.channels).index(channel)]
        for block in blocks
    ])  # fmt: skip


def row_of(fault: Injected, with_fault: Finished, without: Finished) -> Row:
    """Return what `fault` did, from the run with it and the run without."""
    usual = {(event.kind, event.text) for event in without.events}
    during = [event for event in with_fault.events if event.time >= fault.begin]
    new = [event for event in during if (event.kind, event.text) not in usual]
    # a refusal follows from what is found; alone it only shows that something is wrong
    found = [event for event in new if event.kind in DETECTING] or [
        event for event in new if event.kind == EventKind.REFUSED
    ]
    detected = found[0] if found else None
    recovered = next((event for event in during if event.kind == EventKind.RECOVERED and event.time >= fault.end), None)
    steps = np.abs(np.diff(with_fault.ceiling)) * with_fault.rate
    return Row(
        part=fault.part,
        kind=fault.kind,
        felt=_felt(fault, with_fault, without),
        detected=detected,
        recovered=recovered,
        recovery=_recovery(fault, with_fault, without),
        low=float(with_fault.ceiling.min()),
        high=float(with_fault.ceiling.max()),
        fastest=float(steps.max()),
        amplitude=with_fault.amplitude(fault.begin, fault.end) / without.amplitude(fault.begin, fault.end),
        moved=_moved(fault, with_fault, without),
        whole=with_fault.whole,
        complete=len(set(with_fault.answered)) == 1,
        error=with_fault.error,
    )


def _felt(fault: Injected, with_fault: Finished, without: Finished) -> bool:
    """Return whether the failing part gives something else, from the fault's begin on and not before."""
    (one, begin), (other, _) = (_of_part(fault, finished, without) for finished in (with_fault, without))
    return np.array_equal(one[:begin], other[:begin], equal_nan=True) and different(fault, with_fault, without)


def different(fault: Injected, with_fault: Finished, without: Finished) -> bool:
    """Return whether the failing part gives something else from the fault's begin on."""
    (one, begin), (other, _) = (_of_part(fault, finished, without) for finished in (with_fault, without))
    return not np.array_equal(one[begin:], other[begin:], equal_nan=True)


def _of_part(fault: Injected, finished: Finished, without: Finished) -> tuple[Any, int]:
    """Return what the failing part gave in a run, and from which place on the fault is there."""
    if fault.part in STREAMS:
        return finished.streams[fault.part], round(fault.begin * finished.rate)
    if fault.part == "clock":
        return finished.stamps, int(np.searchsorted(without.stamps * 1e-9, fault.begin))
    return finished.states[:, 1], int(np.searchsorted(without.states[:, 0], fault.begin))


def _moved(fault: Injected, with_fault: Finished, without: Finished) -> float:
    """Return the largest difference of the commanded height while the fault is there [m]."""
    one, other = with_fault.commands, without.commands
    count = min(len(one), len(other))
    during = (other[:count, 0] >= fault.begin) & (other[:count, 0] < fault.end)
    return float(np.nanmax(np.abs(one[:count, 1] - other[:count, 1])[during], initial=0.0))


def _recovery(fault: Injected, with_fault: Finished, without: Finished) -> float:
    """Return after which time from the fault's end the height is for good that of the run without it [s]."""
    one, other = with_fault.ceiling, without.ceiling
    count = min(one.size, other.size)
    apart = np.flatnonzero(np.abs(one[:count] - other[:count]) > SAME_HEIGHT * other[:count])
    last = (int(apart[-1]) + 1) / with_fault.rate if apart.size else 0.0
    return math.inf if last >= count / with_fault.rate else max(0.0, last - fault.end)


def problems(row: Row) -> list[str]:
    """Return what is wrong with a row, one line each; none: the graph bore the fault as documented."""
    low, high = SCENE["ceiling"]["range"]
    high += TO_THE_SWITCH if row.part in CEILING else 0.0
    speed = SCENE["ceiling"]["speed"]
    found = {
        "the fault was not felt": not row.felt,
        f"the ceiling was at {row.low:g} to {row.high:g} m, allowed {low:g} to {high:g} m":
            not low - _ROUNDING <= row.low <= row.high <= high + _ROUNDING,
        f"the ceiling moved at {row.fastest:g} m/s, allowed {speed:g} m/s":
            not row.fastest <= speed * (1.0 + _ROUNDING),
        "a block was not answered exactly once": not row.complete,
        "the bag is not whole": not row.whole,
        f"the run ended early: {row.error}": bool(row.error),
    }  # fmt: skip
    return [f"{row.part} {row.kind}: {text}" for text, wrong in found.items() if wrong]
