# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Supervisor, motor and exciter over real DDS on the stand-in T7: all voltages, and when there must be none."""

import itertools
import math
import threading
import time
import traceback
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from atpid_interfaces.msg import Excitation, ExcitationCommand
from excitation_rigs import calibrate_shaker
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.nodes.messages import STATES, STEADY, time_of
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.supervisor_node import SupervisorNode
from atpid_driver.nodes.motor_node import MotorNode
from atpid_driver.standins import Control
from atpid_driver.standins.device import DATA_OFFSET, OUTPUT_HEADER, QUEUE, Outputs
from atpid_exciter.nodes.excitation_node import ExcitationNode

Floats = NDArray[np.float64]
#: Largest amplitude [m], and what a volt is [m/V], as `calibrate_shaker` has it; lowest and highest frequency [Hz].
HIGHEST, SCALE, BAND = 0.01, 0.02, (4.0, 20.0)
#: Shortest time from any output to none, or to the largest [s], and samples a second.
SHORTEST_RAMP, RATE = 0.05, 2000.0
#: A smaller voltage is none [V].
NOTHING = 1e-4
#: So long without an answer, and a needed node is silent; without the supervisor, and nothing is permitted; without a
#: command, and the output ramps down; an estimate that can be used is waited for; the output is at its limits [s].
ANSWER_TIME, SUPERVISION, STALE, BLIND, SATURATION = 0.3, 0.3, 0.3, 0.2, 0.1
#: Share by which a command may be missed and is held.
TOLERANCE = 0.02
EXCITER, MOTOR = "excitation_node", "motor_node"
SUPERVISOR, IDENTIFIER = "supervisor_node", "identifier_node"
NEEDED = [IDENTIFIER, MOTOR, EXCITER]
EXCITER_VALUES: dict[str, Any] = {
    "backend": "labjack_stream", "highest_amplitude": HIGHEST, "lowest_frequency": BAND[0],
    "highest_frequency": BAND[1], "rise_time": SHORTEST_RAMP, "stop_time": SHORTEST_RAMP, "frequency_rate": 40.0,
    "stale_timeout": STALE, "supervision_timeout": SUPERVISION, "supervised": True, "calibration": "output.yaml",
    "hold_timeout": BLIND, "saturation_time": SATURATION, "hold_tolerance": TOLERANCE, "sample_rate": RATE,
}  # fmt: skip
MOTOR_VALUES: dict[str, Any] = {
    "backend": "simulated", "lowest": 0.017, "highest": 1.0, "speed": 0.01, "initial_height": 0.017,
    "supervised": True, "supervision_timeout": SUPERVISION, "rate": 20.0,
}  # fmt: skip
#: A beam that is further away stops everything [m].
ABORT = 0.1
SUPERVISOR_VALUES: dict[str, Any] = {
    "nodes": NEEDED, "needed": NEEDED, "answer_time": ANSWER_TIME, "check_time": 0.0, "give_up": 0.0,
    "beam_displacement_abort": ABORT,
}  # fmt: skip


class Stretch(NamedTuple):
    """From when to when, steady [s]; infinity: it goes on."""

    begin: float
    end: float


class Record(threading.Thread):
    """Every voltage between the device's outputs, what in it breaks a limit, and how late this machine is."""

    PERIOD = 0.004
    #: The process of the output writes so often at least [s].
    WRITES = 0.03

    def __init__(self, file: Path) -> None:
        super().__init__(name="record")
        self._outputs = Outputs(file)
        self._header = np.memmap(file, OUTPUT_HEADER, "r", shape=(1,))[0]
        self._queue = np.memmap(file, np.float64, "r", offset=DATA_OFFSET, shape=(QUEUE,))
        self._over = threading.Event()
        self._chunks: deque[tuple[Floats, Floats]] = deque(maxlen=200)
        self._out: list[float] = []  # when there was an output, steady [s]
        self._known = 0.0  # until then the output is known [s]
        self._late: deque[Stretch] = deque(maxlen=5000)
        self._begun = self._taken = 0
        self._played = -1
        self._fed = 0.0  # when something was written last [s]
        self._crossing = math.nan  # place of the last change of sign
        self._before = 0.0  # the sample before
        self.noise = False  # what is put out need not be a tone
        self.undisturbed = True  # nobody has stopped the process of the output
        self.broken: list[str] = []
        self.samples = 0

    def run(self) -> None:
        due = time.monotonic()
        while not self._over.wait(max(0.0, due - time.monotonic())):
            now = time.monotonic()
            if now - due > 0.01:
                self._late.append(Stretch(due, now))
            due = now + self.PERIOD
            self._look()

    def close(self) -> None:
        self._over.set()
        self.join()

    def forget(self) -> None:
        self._out = []

    def late(self, begin: float, end: float) -> float:
        """Return by how much anything was late at most in that time [s]."""
        return max(
            (one.end - one.begin for one in list(self._late) if one.end > begin and one.begin < end), default=0.0
        )

    def first(self, begin: float, end: float) -> float:
        """Return when there was an output first in that time, steady [s]; NaN: there was none."""
        place = bisect_left(self._out, begin)
        return self._out[place] if place < len(self._out) and self._out[place] <= end else math.nan

    def any(self, begin: float, end: float) -> bool:
        return not math.isnan(self.first(begin, end))

    def recent(self, seconds: float) -> tuple[float, float]:
        """Return amplitude [m] and frequency [Hz] over the last `seconds` [s]; NaN: no tone."""
        begin = time.monotonic() - seconds
        chunks = [chunk for chunk in list(self._chunks) if chunk[0][-1] > begin]
        if not chunks:
            return math.nan, math.nan
        times, volts = (np.concatenate(parts) for parts in zip(*chunks, strict=True))
        places = crossings(volts)
        if len(places) < 3:
            return math.nan, math.nan
        moments = np.interp(places, np.arange(len(times)), times)
        return float(np.abs(volts).max() * SCALE), float(0.5 * (len(places) - 1) / (moments[-1] - moments[0]))

    def _look(self) -> None:
        header, now = self._header, time.monotonic_ns()
        start, written, streams = int(header["start_ns"]), int(header["written"]), bool(header["streams"])
        if start != self._begun or written < self._taken:
            self.undisturbed = self.undisturbed or start != self._begun
            self._begun, self._taken, self._played = start, 0, -1
            self._crossing, self._before, self._fed = math.nan, 0.0, now * 1e-9
        if written > self._taken:
            self._judge(self._queue[np.arange(self._taken, written) % QUEUE] - float(header["volts"][1]))
            self._taken, self._fed = written, now * 1e-9
        elif streams and self.undisturbed and now * 1e-9 - self._fed > self.WRITES:
            self._late.append(Stretch(self._fed, now * 1e-9))
        volts = self._outputs.between(now)
        if streams and written and header["target"] == 0:
            self._play(now, volts, written)
        else:
            self._keep(np.array([now * 1e-9]), np.array([volts]))

    def _keep(self, times: Floats, volts: Floats) -> None:
        new = times > self._known
        if new.any():
            times, volts = times[new], volts[new]
            self._chunks.append((times, volts))
            self._out.extend(times[np.abs(volts) > NOTHING].tolist())
            self._known = float(times[-1])

    def _play(self, now: int, volts: float, written: int) -> None:
        """Keep what a stream has put out since the last look; where the device has restarted it is not the stream."""
        rate = float(self._header["rate"]) or RATE
        last = min(int((now - self._begun) * 1e-9 * rate), written - 1)
        played = np.arange(max(self._played + 1, last - QUEUE // 2), last + 1)
        values = np.asarray(self._queue[played % QUEUE]) - float(self._header["volts"][1])
        times = self._begun * 1e-9 + played / rate
        if len(values) and abs(values[-1] - volts) < NOTHING:
            self._keep(times, values)
        self._played = max(self._played, last)
        if last == written - 1 or abs(volts - (values[-1] if len(values) else volts)) > NOTHING:
            self._keep(np.array([now * 1e-9]), np.array([volts]))

    def _judge(self, values: Floats) -> None:
        """Compare samples (n,) [V], which follow those before, with what may go out at all."""
        self.samples += len(values)
        largest, (low, high) = HIGHEST / SCALE, BAND
        if not np.isfinite(values).all():
            self.broken.append("a sample is no number")
            return
        if (peak := float(np.abs(values).max())) > largest * (1.0 + 1e-6):
            self.broken.append(f"{peak * SCALE:g} m are put out; allowed: {HIGHEST:g} m")
        both = np.append(self._before, np.where(np.abs(values) < 1e-9, 0.0, values))
        fastest = largest * (2.0 * math.pi * high + 1.0 / SHORTEST_RAMP) / RATE
        if (step := float(np.abs(np.diff(both)).max())) > fastest * 1.01:
            self.broken.append(f"a step of {step:g} V from one sample to the next; allowed: {fastest:g} V")
        self._before = float(both[-1])
        if self.noise:
            self._crossing = math.nan
            return
        places = crossings(both)
        zeros = np.flatnonzero(both == 0.0)
        for place in places:
            since = self._crossing
            if not math.isnan(since) and not ((zeros > since) & (zeros < place)).any():
                frequency = 0.5 * RATE / (place - since)
                if not low * 0.99 <= frequency <= high * 1.01:
                    self.broken.append(f"{frequency:g} Hz are put out; allowed: {low:g} to {high:g} Hz")
            self._crossing = place
        if len(zeros) and not self._crossing > zeros[-1]:
            self._crossing = math.nan
        self._crossing -= len(values)


def crossings(values: Floats) -> Floats:
    """Return where values (n,) change their sign (m,), between two of them."""
    at = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    return np.asarray(at + values[at] / (values[at] - values[at + 1]))


class Spinner(threading.Thread):
    """Spins a node in a thread of its own, unless that is to hang."""

    #: A turn that takes longer is a node that does not answer [s].
    LONG = 0.12

    def __init__(self, node: Node, context: Context) -> None:
        super().__init__(name=str(node.get_name()))
        self.node, self._executor = node, TurnExecutor(context=context)
        self._executor.add_node(node)
        self._until, self._ended = 0.0, False
        self.hangs: list[Stretch] = []
        self.busy: list[Stretch] = []
        self.error: Exception | None = None

    def hang(self, seconds: float) -> None:
        self._until = time.monotonic() + seconds

    @property
    def unresponsive(self) -> list[Stretch]:
        return self.hangs + self.busy

    @property
    def hanging(self) -> bool:
        """Whether it hangs, or is about to."""
        return time.monotonic() < self._until or bool(self.hangs and math.isinf(self.hangs[-1].end))

    def run(self) -> None:
        while not self._ended:
            begin = time.monotonic()
            if begin < self._until:
                self.hangs.append(Stretch(begin, math.inf))
                while time.monotonic() < self._until and not self._ended:
                    time.sleep(0.005)
                self.hangs[-1] = Stretch(begin, time.monotonic())
                continue
            try:
                self._executor.spin_once(timeout_sec=0.05)
            except Exception as error:  # the test that looks raises it again
                traceback.print_exc()  # hypothesis may have another error than the first
                self.error = error
                return
            if time.monotonic() - begin > self.LONG:
                self.busy.append(Stretch(begin, time.monotonic()))

    def close(self) -> None:
        self._ended = True
        self.join()
        self._executor.shutdown()


class Estimate(NamedTuple):
    """One that was published: when, of when it is, and what it says."""

    at: float  # steady [s]
    of: float  # by its stamp, steady [s]
    quality: int
    amplitude: float  # [m]
    frequency: float  # [Hz]
    usable: bool
    put: tuple[float, float]  # what the device put out [m], [Hz]


@dataclass
class Identifier:
    """A node that estimates the excitation from the device's voltage, as well as it is told to."""

    node: Node
    record: Record
    quality: int = Excitation.STEADY
    gain: float = 1.0  # identified over put out
    pitch: float = 1.0  # the same of the frequency
    way: str = "fresh"  # frozen: the last one again; late: of before; none
    sent: deque[Estimate] = field(default_factory=lambda: deque(maxlen=2000))

    WINDOW, LATE = 0.2, 0.3

    def __post_init__(self) -> None:
        self._publisher = self.node.create_publisher(Excitation, "excitation", STATES)
        self._last: Excitation | None = None
        self._of, self._put = -math.inf, (math.nan, math.nan)
        self.node.create_timer(0.05, self._estimate, clock=STEADY)

    def honest(self) -> None:
        self.quality, self.gain, self.pitch, self.way = Excitation.STEADY, 1.0, 1.0, "fresh"

    def _estimate(self) -> None:
        if self.way == "none":
            return
        now, wall = time.monotonic(), time.time()
        if self.way != "frozen" or self._last is None:
            amplitude, frequency = self.record.recent(self.WINDOW)
            quality = self.quality if math.isfinite(amplitude) else Excitation.NONE
            self._last = Excitation(quality=quality, amplitude=self.gain * amplitude, frequency=self.pitch * frequency,
                                    window=0.01)  # fmt: skip
            back = self.LATE if self.way == "late" else 0.0
            self._last.header.stamp = time_of(round((wall - back) * 1e9))
            self._put = amplitude, frequency
        made = self._last
        of = made.header.stamp.sec + made.header.stamp.nanosec * 1e-9 - wall + now
        good = made.quality in (Excitation.STEADY, Excitation.TRANSIENT)
        usable = good and of > self._of + 1e-4 and now - of < 0.5
        self._of = of
        self.sent.append(Estimate(now, of, made.quality, made.amplitude, made.frequency, usable, self._put))
        self._publisher.publish(made)


class Graph:
    """The nodes, each in a thread of its own, the device, and an executor for what the test itself adds."""

    def __init__(self, folder: Path, library: Path) -> None:
        self.folder = folder
        calibrate_shaker(folder)
        self.control = Control(folder / "control")
        self.record = Record(folder / "output")
        self.context = Context()
        rclpy.init(context=self.context)
        more = {"library": str(library / "libLabJackM.so"), "calibration_folder": str(folder)}
        self.exciter = self._made(ExcitationNode, EXCITER_VALUES | more)
        self.motor = self._made(MotorNode, MOTOR_VALUES)
        self.supervisor = self._made(SupervisorNode, SUPERVISOR_VALUES)
        self.identifier = Identifier(Node("identifier_node", context=self.context), self.record)
        nodes = (self.exciter, self.motor, self.supervisor, self.identifier.node)
        self.spinners = {str(node.get_name()): Spinner(node, self.context) for node in nodes}
        self.executor = TurnExecutor(context=self.context)
        self._own: list[Node] = []
        self.record.start()
        for spinner in self.spinners.values():
            spinner.start()

    def _made(self, kind: Any, values: dict[str, Any]) -> Any:
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        return kind(parameter_overrides=parameters, context=self.context)

    def add(self, name: str) -> Node:
        self._own.append(Node(name, context=self.context))
        self.executor.add_node(self._own[-1])
        return self._own[-1]

    def remove(self, node: Node) -> None:
        self._own.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def unresponsive(self, names: Sequence[str]) -> list[Stretch]:
        """Return when any of these nodes did not spin."""
        return [one for name in names for one in self.spinners[name].unresponsive]

    def raise_errors(self) -> None:
        for spinner in self.spinners.values():
            if spinner.error is not None:
                raise spinner.error

    def close(self) -> None:
        for spinner in self.spinners.values():  # that of the output first
            spinner.close()
        self.exciter.destroy_node()
        self.motor.destroy_node()
        self.supervisor.close()
        self.record.close()
        for node in (self.supervisor, self.identifier.node, *self._own):
            with suppress(Exception):
                node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)
        self.control.close()


#: Until the output is off after a stop, where something hangs, and where only the device's watchdog is left: twice what
#: is promised for the first two, since milliseconds are measured elsewhere [s].
STOPPED, HUNG, UNREACHABLE = 0.4, 0.9, 3.6
#: A node that hangs for so long has been noticed for certain [s].
NOTICED = {
    EXCITER: 0.25 + 0.2, SUPERVISOR: SUPERVISION + 0.2, IDENTIFIER: ANSWER_TIME + 0.3, MOTOR: ANSWER_TIME + 0.3,
}  # fmt: skip
#: A rule about something that lasts is not judged before it has lasted so much longer [s].
CLEAR = 0.5


@dataclass
class Decision:
    """A command, and when it was published."""

    message: ExcitationCommand
    first: float
    refused: bool
    sent: list[float] = field(default_factory=list)

    @property
    def moves(self) -> bool:
        """Whether it may be followed, and moves something."""
        return self.message.kind != ExcitationCommand.OFF and not self.refused


@dataclass
class Arm:
    """A request to arm the exciter: when, and whether it has been refused, None: no answer yet."""

    at: float
    refused: bool | None = None


@dataclass
class Ban:
    """No output from `since` + `allowed` on."""

    why: str
    since: float
    allowed: float
    nodes: tuple[str, ...] = (EXCITER,)  # that have to do something about it
    latched: bool = True
    until: float = math.inf  # it ends by itself
    confirmed: float = math.inf  # when somebody was told that the output is off


@dataclass
class Hang:
    """A node that began to hang while something was commanded."""

    name: str
    begin: float


def refused(command: ExcitationCommand) -> bool:
    """Return whether a command is outside the limits for certain."""
    low, high = BAND
    if command.kind == ExcitationCommand.OFF:
        return False
    if not 0.0 <= command.amplitude <= HIGHEST * 1.001 or not low * 0.999 <= command.frequency <= high * 1.001:
        return True
    if command.kind == ExcitationCommand.SINE:
        return False
    if not low * 0.999 <= command.end_frequency <= high * 1.001:
        return True
    return bool(command.hold and command.kind == ExcitationCommand.RANDOM)


class Account:
    """When there must be no output, by what was done to the nodes alone, in order; it shares no code with them.

    A *ban* says that nothing may be put out from some instant on. One that is latched is lifted by an arm that was
    asked for after its cause began, and a command decided after that was asked for; another by a command decided after
    its cause. Only what is certain becomes a ban: where it is not known which of two things came first there is none.
    Times are steady [s].
    """

    def __init__(self, record: Record, unresponsive: Callable[[Sequence[str]], list[Stretch]]) -> None:
        """Begin with nothing done; unresponsive: returns when any of these nodes did not spin."""
        self._record, self._of_nodes = record, unresponsive
        self.arms: list[Arm] = []
        self.decisions: list[Decision] = []
        self.bans: list[Ban] = []
        self.hangs: list[Hang] = []
        self.others: list[Stretch] = []  # when another one could command, too
        self.disturbed: list[Stretch] = []  # when process of the output or device could not do what they were asked for
        self._silences = 0  # of the commander that are judged

    def ban(self, why: str, since: float, allowed: float, *nodes: str, **more: Any) -> Ban:
        self.bans.append(Ban(why, since, allowed, (EXCITER, *nodes), **more))
        return self.bans[-1]

    def arm(self, at: float) -> Arm:
        self.arms.append(Arm(at))
        return self.arms[-1]

    @property
    def decision(self) -> Decision | None:
        return self.decisions[-1] if self.decisions else None

    def lifted(self, ban: Ban) -> float:
        """Return when something may be put out again; infinity: it may not yet."""
        since = ban.since
        if ban.latched:
            since = min((one.at for one in self.arms if one.at > since and not one.refused), default=math.inf)
        return min([ban.until, *(one.first for one in self.decisions if one.moves and one.first > since)])

    def due(self, ban: Ban) -> float:
        """Return from when on nothing may be put out: what cannot act has its time afterwards."""
        due = ban.since + ban.allowed
        stretches = sorted([*self._of_nodes(ban.nodes), *self.disturbed], key=lambda one: one.begin)
        for begin, end in stretches:
            if begin < due and end > ban.since:
                due = max(due, end + ban.allowed)
        due += 3.0 * self._record.late(ban.since, due)
        return min(due, ban.confirmed)

    def broken(self, now: float) -> str:
        """Return the first ban that was broken up to `now`, in words; empty: none."""
        for ban in self.bans:
            due, lifted = self.due(ban), self.lifted(ban)
            at = self._record.first(due, min(lifted, now)) if due < min(lifted, now) else math.nan
            if not math.isnan(at):
                return f"output at {at:.3f} s: {ban.why} at {ban.since:.3f} s, off from {due:.3f} s on"
        return ""

    def pending(self, now: float) -> bool:
        """Whether a ban is not due yet."""
        return any(now < self.due(ban) and now < self.lifted(ban) for ban in self.bans)

    def stopped(self) -> bool:
        """Whether any ban holds."""
        return any(math.isinf(self.lifted(ban)) for ban in self.bans)

    def commanded(self, begin: float, end: float) -> bool:
        """Whether the exciter followed a command for certain all the time."""
        before = [one for one in self.decisions if one.first < begin]
        if not before or not self._runs(before[-1], begin):
            return False
        within = [one for one in self.decisions if begin <= one.first <= end]
        if not all(one.moves and one.message.kind != ExcitationCommand.RANDOM for one in within):
            return False
        sent = [at for one in (before[-1], *within) for at in one.sent if begin - 0.4 < at <= end + 0.2]
        gaps = [after - at for at, after in itertools.pairwise(sent)]
        if max(gaps, default=1.0) > 0.5 * STALE or sent[0] > begin - 0.1 or sent[-1] < end - 0.2:
            return False
        return not any(one.begin <= end and one.end >= begin - 0.3 for one in self.others)

    def _runs(self, decision: Decision, at: float) -> bool:
        if not decision.moves or at - decision.first < (
            0.5 if decision.message.kind == ExcitationCommand.RANDOM else 0.2
        ):
            return False
        if any(ban.since <= at and self.lifted(ban) > at for ban in self.bans):
            return False
        return self._record.any(at - 0.06, at)

    def follow(self, now: float, estimates: Sequence[Estimate]) -> None:
        """Add what follows from what has lasted up to `now`."""
        self._follow_hangs(now)
        self._follow_silence(now)
        self._follow_hold(now, estimates)

    def _sure(self, begin: float, end: float) -> float:
        """Return how long something has lasted for everybody, whatever was late [s]."""
        return end - begin - 3.0 * self._record.late(begin, end)

    def _follow_hangs(self, now: float) -> None:
        for hang in list(self.hangs):
            stretch = next((one for one in self._of_nodes([hang.name]) if one.end > hang.begin), None)
            if stretch is None:
                continue
            begin, needed = stretch.begin, NOTICED[hang.name]
            if self._sure(begin, min(now, stretch.end)) > needed:
                self.hangs.remove(hang)
                others = {EXCITER, SUPERVISOR} - {hang.name}
                answered = not any(one.begin < begin + needed and one.end > begin for one in self._of_nodes([*others]))
                if answered and self.commanded(begin, begin + needed):
                    self.bans.append(Ban(f"{hang.name} hung", begin, HUNG, tuple({EXCITER} - {hang.name})))
            elif now > stretch.end:
                self.hangs.remove(hang)

    def _follow_silence(self, now: float) -> None:
        """The commander was silent, or sent only what must not be followed."""
        sent = [(at, one) for one in self.decisions if not one.refused for at in one.sent]
        if not sent:
            return
        for (at, one), (after, _) in zip(
            sent[self._silences :], [*sent[self._silences + 1 :], (now, None)], strict=True
        ):
            if not one.moves:
                continue
            lasted = self._sure(at, after) - sum(
                min(end, after) - max(begin, at)
                for begin, end in self._of_nodes([EXCITER])
                if begin < after and end > at
            )
            if lasted > STALE + CLEAR and not any(ban.since == at and ban.why == "silence" for ban in self.bans):
                self.ban("silence", at, STALE + STOPPED, latched=False)
        self._silences = max(0, len(sent) - 1)

    def _follow_hold(self, now: float, estimates: Sequence[Estimate]) -> None:
        """Nothing usable was identified, or the output was at its limits and missed the command."""
        decision = self.decision
        if (
            decision is None
            or not decision.moves
            or not decision.message.hold
            or not self.commanded(now - 0.3, now - 0.1)
        ):
            return
        command = decision.message
        frequency = min(
            command.frequency, *([command.end_frequency] if command.kind == ExcitationCommand.SWEEP else []), math.inf
        )
        blind = max(BLIND, 5.0 / frequency)
        usable = max((one.at for one in estimates if one.usable), default=0.0)
        begin = max(decision.first + 0.25, usable)
        if self._sure(begin, now) > blind + CLEAR and self.commanded(begin, now - 0.1):
            self.ban(f"nothing usable was identified for {blind:g} s", begin, blind + STOPPED)
        self._follow_saturation(now, decision, estimates)

    def _follow_saturation(self, now: float, decision: Decision, estimates: Sequence[Estimate]) -> None:
        command, begin = decision.message, decision.first + 0.25
        if command.kind != ExcitationCommand.SINE:
            return
        for one in reversed(estimates):
            short = one.amplitude < command.amplitude * (1.0 - 3.0 * TOLERANCE) and one.put[0] > HIGHEST * 0.999
            slow = one.frequency < command.frequency * (1.0 - 3.0 * TOLERANCE) and one.put[1] > BAND[1] * 0.999
            if one.at < begin or not one.usable or not (short or slow):
                begin = max(begin, one.at)
                break
        # the controller's first step comes after the delay of its estimates
        if self._sure(begin, now) > SATURATION + 0.5 + CLEAR and self.commanded(begin, now - 0.1):
            self.ban("the output is at its limits and misses the command", begin, SATURATION + 0.5 + STOPPED)
