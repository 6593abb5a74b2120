# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rows of the matrix that need real time: the serial link on the emulated stand, and the recorder as a process."""

import math
import os
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import Event

from atpid_common.injected_faults import LINK, Injected
from atpid_common.vocabulary import EventKind, Mode
from atpid_control.runs.check import check
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import repair
from atpid_control.runs.verify import verify
from atpid_control.selection.map_cache import map_for
from atpid_control.stand.emulated import commands_emulated, emulator_command, parameters_emulated
from atpid_control.stand.errors import BenchError
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import parameters_for
from atpid_control.stand.running import commands_of, run_realtime
from atpid_driver.emulator import missing_tools
from studies.emulated_board import EmulatedBoard
from studies.fault_matrix.run import DETECTING, SAME_HEIGHT, SCENE, Seen, scene_with

#: The run: the ceiling is on its way up when the fault begins.
DURATION, BEGIN, END = 9.5, 1.5, 4.5
#: When a person arms the motor again [s].
REARM = 4.9
#: How far the board lets its ceiling go beyond its limits (SOFT_MARGIN_UM of the firmware) [m].
_MARGIN = 0.004
#: Kinds of event by which a fault is found: a link that answers late still works.
_FINDING = (*DETECTING, EventKind.LINK, EventKind.SLOW)
#: What breaks a rule whatever the link does; heights that come late sample fast.
_RULES = ("unanswered", "twice", "unasked", "index", "message", "file")
#: Kinds that end the run: what is recorded until then is kept.
ENDING = (("recorder", "off"), ("recorder", "wrong"))


@dataclass
class Sample:
    """The board and the bag's file at one instant of the run."""

    time: float  # [s]
    size: int = 0  # of the file [bytes]
    motor: int = 0  # current of the board's motor: 1, 0, -1; of a simulated one whether it moves
    height: float = math.nan  # true [m]
    silent: float = 0.0  # since the board received a byte [s]


@dataclass
class Paced:
    """What a run in real time left behind."""

    bag: Path
    events: list[Seen] = field(default_factory=list)
    looks: list[Sample] = field(default_factory=list)
    reported: list[tuple[float, float]] = field(default_factory=list)  # time [s], height [m] of ceiling/state
    error: str = ""  # how the run ended early

    @property
    def late(self) -> bool:
        """Whether the simulated plant fell behind the clock: on a busy machine the run is not that of the fault."""
        return any(event.kind == Event.BEHIND for event in self.events)


@dataclass(frozen=True)
class PacedRow:
    """One fault of the matrix, injected in real time, and what it did."""

    part: str
    kind: str
    felt: bool
    detected: Seen | None
    recovered: Seen | None
    motor_off: float  # after the fault's begin [s]; NaN: it did what it does without the fault
    back: bool  # whether the ceiling ends where it does without the fault, a person having armed the motor
    low: float  # of the board's ceiling [m]
    high: float
    bag: str  # "whole", "whole after repair", or what is wrong with it
    recorded: float  # [s]
    broken: tuple[str, ...]  # rules, by the check of the bag
    error: str


def run(fault: Injected | None, part: str, folder: Path, name: str) -> Paced:
    """Run the graph in real time with `fault` of `part`, or without; bag, scene and logs stay in `folder`.

    Raises BenchError where the serial link cannot be emulated here, AtpidError of bad input.
    """
    emulated = part in LINK
    if emulated and missing_tools():
        raise BenchError(f"{part}: needs the emulated board: {' '.join(missing_tools())} (sudo make avr-tools)")
    excitation = SCENE["excitation"] | {"amplitude": [[0.0, 0.0], [0.2, 0.03], [20.0, 0.03]]}
    usual = SCENE | {"duration": DURATION, "excitation": excitation}
    scene, file = scene_with((fault,) if fault else (), folder, name, usual)
    logs = folder / f"{name}-log"
    logs.mkdir()
    os.environ["ROS_LOG_DIR"] = str(logs)
    paced = Paced(folder / name)
    height_map = map_for(scene)
    with ExitStack() as stack:
        if emulated:
            place = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="atpid-stand-")))
            parameters = parameters_emulated(scene, file, height_map, paced.bag, place, board=True)
            command = emulator_command(scene, place, "--height", "0.98")
            board: EmulatedBoard | None = EmulatedBoard(command, logs / "emulator.log")
            stack.callback(board.close)  # type: ignore[union-attr]
        else:
            parameters = parameters_for(scene, file, height_map, paced.bag, lockstep=False)
            board = None
        parameter_file = folder / f"{name}-parameters.yaml"
        write_parameters(parameters, parameter_file)
        commands = commands_of(parameter_file)
        if emulated:
            started = commands_emulated(scene, parameter_file, place, board=True)
            commands = [one for one in started if one[0] != "emulator"]
        follow = _Following(paced, board)
        try:
            calls = [(REARM, "supervisor_node/rearm")]
            run_realtime(commands, logs, lambda _: None, follow=follow.take, calls=calls, faults=scene.injected)
        except BenchError as failure:
            paced.error = str(failure)
    return paced


class _Following:
    """Takes each message of the run as it comes, and looks at the board and at the bag's file then."""

    def __init__(self, paced: Paced, board: EmulatedBoard | None) -> None:
        self._paced, self._board = paced, board

    def take(self, moment: float, message: Any) -> None:
        if message.handshake:
            return
        if hasattr(message, "severity"):
            self._paced.events.append(Seen(moment, int(message.severity), str(message.kind), str(message.text)))
        elif hasattr(message, "mode"):
            self._paced.reported.append((moment, float(message.height)))
            self._look(moment, int(message.mode == Mode.MOVING))

    def _look(self, moment: float, moving: int) -> None:
        sample = Sample(moment, sum(file.stat().st_size for file in self._paced.bag.glob("*.mcap")), moving)
        if self._board is not None:
            state = self._board.state()
            sample = replace(
                sample, motor=state.motor, height=state.height_um * 1e-6, silent=(state.ms - state.last_byte_ms) * 1e-3
            )  # fmt: skip
        self._paced.looks.append(sample)


def row_of(fault: Injected, with_fault: Paced, without: Paced) -> PacedRow:
    """Return what `fault` did; the bag of a run that ended early is repaired."""
    usual = {(event.kind, event.text) for event in without.events}
    during = [event for event in with_fault.events if event.time >= fault.begin]
    detected = next((one for one in during if one.kind in _FINDING and (one.kind, one.text) not in usual), None)
    back = [one for one in during if one.time >= fault.end and one is not detected]
    recovered = next(
        (one for one in back if one.kind in (EventKind.RECOVERED, EventKind.RESUMED) or "again" in one.text), None
    )
    bag, recorded, broken = _bag_of(with_fault.bag)
    heights = [sample.height for sample in with_fault.looks if sample.time >= 0.0 and math.isfinite(sample.height)]
    return PacedRow(
        part=fault.part,
        kind=fault.kind,
        felt=_had_effect(fault, with_fault, without, bag),
        detected=detected,
        recovered=recovered,
        motor_off=off if (off := _motor_off(fault, with_fault)) < _motor_off(fault, without) - 0.1 else math.nan,
        back=_returned(with_fault, without),
        low=min(heights, default=math.nan),
        high=max(heights, default=math.nan),
        bag=bag,
        recorded=recorded,
        broken=broken,
        error=with_fault.error,
    )


def _returned(with_fault: Paced, without: Paced) -> bool:
    """Return whether the ceiling, as reported, ends where it does without the fault; NaN: it is not known."""
    if not with_fault.reported or not without.reported:
        return False
    here, usual = with_fault.reported[-1][1], without.reported[-1][1]
    return abs(here - usual) <= SAME_HEIGHT * usual


def _motor_off(fault: Injected, paced: Paced) -> float:
    """Return after which time the motor, on at the fault's begin, was off for the fault's rest [s]."""
    during = [sample for sample in paced.looks if fault.begin <= sample.time < fault.end]
    on = [sample for sample in during if sample.motor]
    if not during or not during[0].motor or during[-1].motor:
        return math.nan
    return on[-1].time - fault.begin


def _bag_of(path: Path) -> tuple[str, float, tuple[str, ...]]:
    """Return whether the bag is whole, for how long the run is in it [s], and the rules broken."""
    state = "whole"
    try:
        verify(path)
    except BagError as error:
        state = str(error)
        try:
            repair(path)
            verify(path)
            state = "whole after `repair`"
        except BagError:
            return state, math.nan, ()
    scans = [
        (int(block.first_index) + len(block.data) // len(block.channels)) / block.rate
        for _, block in open_bag(path).messages("/sensors/laser")
    ]
    checked = check(path)
    return state, max(scans, default=0.0), tuple(line for line in checked.findings if line.split(":")[0] in _RULES)


def _had_effect(fault: Injected, with_fault: Paced, without: Paced, bag: str) -> bool:
    """Return whether the fault showed outside the part that has it: at the board, or in the bag's file."""
    if fault.part in LINK and fault.kind == "wrong":
        return _height_error(fault, with_fault) > 0.5 * abs(fault.value) > 2.0 * _height_error(fault, without)
    if fault.part in LINK:
        return _silence(fault, with_fault) > max(0.1, 2.0 * _silence(fault, without))
    if fault.kind == "garbage":
        return bag != "whole"
    if (fault.part, fault.kind) in ENDING:
        return bool(with_fault.error) and not without.error
    return _longest_stall(fault, with_fault) > _longest_stall(fault, without) + 0.2


def _silence(fault: Injected, paced: Paced) -> float:
    """Return the longest time in which the board received nothing, or in which no height was reported anew [s]."""
    during = [sample for sample in paced.looks if fault.begin <= sample.time < fault.end]
    return max((sample.silent for sample in during), default=0.0)


def _height_error(fault: Injected, paced: Paced) -> float:
    """Return by how much the heights reported differ from the true ones at the fault's end, at rest [m]."""
    reported = {moment: height for moment, height in paced.reported if math.isfinite(height)}
    last = [
        sample
        for sample in paced.looks
        if sample.time < fault.end - 0.1 and sample.time in reported and not sample.motor
    ]
    return abs(reported[last[-1].time] - last[-1].height) if last else 0.0


def _longest_stall(fault: Injected, paced: Paced) -> float:
    """Return the longest time in which the bag's file did not grow while the fault was there [s]."""
    longest, since, size = 0.0, math.nan, -1
    for sample in paced.looks:
        if not fault.begin - 0.5 <= sample.time < fault.end + 0.5:
            continue
        if sample.size != size:
            since, size = sample.time, sample.size
        longest = max(longest, sample.time - since)
    return longest


def problems(row: PacedRow) -> list[str]:
    """Return what is wrong with a row, one line each; none: the graph bore the fault as documented."""
    low, high = SCENE["ceiling"]["range"]
    ends = (row.part, row.kind) in ENDING
    spoilt = row.part == "recorder" and row.kind == "garbage"
    found = {
        "the fault was not felt": not row.felt,
        f"the ceiling was at {row.low:g} to {row.high:g} m, allowed {low:g} to {high:g} m":
            row.low < low - _MARGIN or row.high > high + 0.012 + _MARGIN,
        f"the run ended early: {row.error}": bool(row.error) and not ends,
        "the ceiling is not where it is without the fault": not row.back and not ends,
        "the run went on": ends and not row.error,
        f"the bag is {row.bag}": not spoilt and row.bag != ("whole after `repair`" if ends else "whole"),
        f"{row.recorded:g} s are in the bag": not ends and not spoilt and not row.recorded >= DURATION - 0.1,
        f"until {row.recorded:g} s in the bag": ends and not row.recorded >= BEGIN - 1.1,
        **{f"check: {line}": not ends and not spoilt for line in row.broken},
    }  # fmt: skip
    return [f"{row.part} {row.kind}: {text}" for text, wrong in found.items() if wrong]
