# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stops on a line that delays, loses and garbles, before the real firmware, in the board's own time.

Each interleaving draws a line, a number of heights, readings and pauses, and then a stop or a disarm at any instant.
The host is the product's own dialogue; host, line and board share one simulated clock, so a run is repeatable and does
not depend on what else the machine does.
"""

import random
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path

from atpid_common.injected_faults import KINDS, Injected
from atpid_common.vocabulary import Mode
from atpid_driver.emulator import Emulator
from atpid_driver.emulator.line import Disturbance, InjectedFaults
from atpid_driver.motor.dialogue import Dialogue
from atpid_driver.motor.faults import LinkError
from atpid_driver.motor.settings import MotorSettings

#: Step of the common clock [s]: an answer is never read earlier than the board has sent it.
STEP = 0.001
#: A stop's frame is on the wire, and the motor off, within [s].
ON_WIRE, OFF = 0.030, 0.200
#: How long the stand is watched after a stop [s].
WATCHED = 0.5
_SETTINGS = MotorSettings(backend="serial", lowest=0.017, highest=1.0, speed=0.3, port="emulated", identify_timeout=3.0)
#: By the firmware's heartbeat, where no frame passes to the board [s].
BY_HEARTBEAT = 0.500


class Noise:
    """Frames that are late by a random time, lost or garbled, in each direction with its own chance."""

    def __init__(
        self, seed: int, *, delay: tuple[float, float] = (0.0, 0.0), lost: float = 0.0, garbled: float = 0.0,
        requests_late: bool = False,
    ) -> None:  # fmt: skip
        """delay: bounds [s] of answers, and of requests where `requests_late`; lost, garbled: shares of all frames."""
        self._random = random.Random(seed)
        self._delay, self._lost, self._garbled, self._requests_late = delay, lost, garbled, requests_late

    def passed(self, frame: bytes, to_board: bool, now: float) -> tuple[float, bytes] | None:
        """See `Disturbance`."""
        kind = self._random.random()
        if kind < self._lost:
            return None
        if kind < self._lost + self._garbled:
            changed = bytearray(frame)
            changed[self._random.randrange(len(changed))] ^= 1 << self._random.randrange(7)
            frame = bytes(changed)
        late = self._requests_late or not to_board
        return now + (self._random.uniform(*self._delay) if late else 0.0), frame


@dataclass(frozen=True)
class Line:
    """A kind of line: its name, what it does, and within which time the motor is off whatever it does [s]."""

    name: str
    disturbance: Callable[[int], Disturbance]  # of a seed
    allowed: float = OFF


def _noise(lost: float, delay: float, *, requests_late: bool = False) -> Callable[[int], Disturbance]:
    return lambda seed: Noise(seed, delay=(0.0, delay), lost=lost, garbled=lost, requests_late=requests_late)


def _fault(kind: str) -> Callable[[int], Disturbance]:
    """It begins while the first travel is under way."""
    return lambda seed: InjectedFaults([Injected("serial_link", kind, random.Random(seed).uniform(0.1, 0.5), 1e6)])


LINES = (
    Line("answers at once", _noise(0.0, 0.0)),
    Line("answers late by up to 100 ms", _noise(0.0, 0.1)),
    Line("one in ten lost, one in ten garbled", _noise(0.1, 0.0)),
    Line("answers late, frames lost and garbled", _noise(0.1, 0.1)),
    Line("requests late too, frames lost and garbled", _noise(0.1, 0.1, requests_late=True)),
    *(
        Line(f"`{kind}`", _fault(kind), BY_HEARTBEAT if kind in ("off", "garbage", "slow", "intermittent") else OFF)
        for kind in KINDS
    ),
)


@dataclass(frozen=True)
class Stop:
    """What became of one stop; time from the call until the motor was off [s], NaN: it was off already."""

    line: str
    word: str
    off: float
    problems: tuple[str, ...]


@dataclass
class Host:
    """The dialogue, a line and the board on one clock."""

    emulator: Emulator
    now: float = 0.0
    line: Disturbance = field(default_factory=lambda: Noise(0))
    written: list[tuple[float, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.emulator.do("unplug")  # no port: bytes go straight to the board
        self.emulator.run(0.05)
        self.emulator.received()
        self.dialogue = Dialogue(_SETTINGS)
        self.dialogue.opened(self.now)
        self._rest = b""
        self._to_board: deque[tuple[float, bytes]] = deque()
        self._to_host: deque[tuple[float, bytes]] = deque()

    def run(self, seconds: float, *, alive: bool = True) -> None:
        """Let time pass; `alive`: the caller reads meanwhile, as the motor node does."""
        for _ in range(round(seconds / STEP)):
            self.step(alive=alive)

    def step(self, *, alive: bool = True) -> None:
        """Let one step pass."""
        if alive:
            self.dialogue.keep_alive(self.now)
        try:
            while (frame := self.dialogue.due(self.now)) is not None:
                self.written.append((self.now, frame))
                self._pass(frame, self._to_board, to_board=True)
            for data in self._arrived(self._to_board):
                self.emulator.send(data)
            self.emulator.run(STEP)
            self.now += STEP
            *lines, self._rest = (self._rest + self.emulator.received()).split(b"\n")
            for text in lines:
                self._pass(text + b"\n", self._to_host, to_board=False)
            for data in self._arrived(self._to_host):
                self.dialogue.read(data, self.now)
        except LinkError as error:
            self.dialogue.lost(error)
            self.dialogue.opened(self.now)

    def _pass(self, data: bytes, waiting: deque[tuple[float, bytes]], *, to_board: bool) -> None:
        if (passed := self.line.passed(data, to_board, self.now)) is not None:
            waiting.append((max(passed[0], waiting[-1][0] if waiting else 0.0), passed[1]))

    def _arrived(self, waiting: deque[tuple[float, bytes]]) -> Iterator[bytes]:
        while waiting and waiting[0][0] <= self.now:
            yield waiting.popleft()[1]

    def make_ready(self) -> None:
        """Arm on a line that passes everything, and home where the height is lost."""
        self.line = Noise(0)
        while self._to_board or self._to_host:  # what the last line still has on its way
            self.step()
        for _ in range(50):
            if self.dialogue.ready and not (self.dialogue.reading.ready and self.dialogue.heartbeat):
                self.dialogue.arm(self.now)
            self.run(0.1)
            while self.dialogue.reading.mode is Mode.HOMING:
                self.run(0.1)
            if self.dialogue.reading.ready and self.dialogue.heartbeat and not self.dialogue.stopping:
                return
        raise LinkError(f"the emulated board does not get ready: {self.dialogue.reading}")


def interleaving(host: Host, rng: random.Random) -> Stop:
    """Draw a line and what is wanted of the board, then stop at any instant, and watch."""
    host.make_ready()
    line = rng.choice(LINES)
    host.line = line.disturbance(rng.randrange(2**31))
    for _ in range(rng.randint(1, 6)):
        target = rng.choice((30_000, 970_000, rng.randrange(17_000, 1_000_001)))
        kind = rng.random()
        if kind < 0.7:
            host.dialogue.move(target, 1, host.now)
        elif kind < 0.85:
            host.dialogue.hold(1, host.now)
        host.run(rng.choice((0.0, 0.001, rng.uniform(0.0, 0.4))))
    if host.dialogue.goal is None:
        host.dialogue.move(30_000 if host.dialogue.reading.height > 0.5 else 970_000, 1, host.now)
        host.run(rng.choice((0.0, 0.001, rng.uniform(0.0, 0.4))))
    return stop(host, line, rng.choice(("STOP", "DISARM")))


def stop(host: Host, line: Line, word: str) -> Stop:
    """Stop (`word`: STOP or DISARM) on `line`, and watch what becomes of it."""
    dialogue, emulator = host.dialogue, host.emulator
    begun, called, before = len(host.written), host.now, emulator.state()
    on_its_way = dialogue.stopping and word == "STOP"  # a hold from just before serves
    off: Future[None] | None = None
    if word == "DISARM":
        off = dialogue.disarm(host.now)
    else:
        dialogue.hold(2, host.now)
    needed, confirmed, problems = dialogue.stopping, False, []
    while host.now - called < WATCHED:
        host.step()
        if needed and not confirmed and not dialogue.stopping:
            confirmed = True
            if emulator.state().motor:
                problems.append("confirmed while the motor was on")
    after, frames = emulator.state(), host.written[begun:]
    # ID, by which a board is found again, disarms it
    stops = [when for when, frame in frames if b"STOP" in frame or b"DISARM" in frame or b",ID*" in frame]
    if any(b"MOVE" in frame or b"HOME" in frame for _, frame in frames):
        problems.append("a height was written after the stop")
    if needed and not on_its_way and (not stops or stops[0] - called > ON_WIRE):
        problems.append("the stop was not on the wire in time")
    if after.motor:
        problems.append("the motor is on")
    ran = before.motor != 0 or after.switched != before.switched
    switched_off = (after.motor_off_ms - before.ms) * 1e-3 if ran else float("nan")
    if switched_off > line.allowed:
        problems.append(f"motor off after {1e3 * switched_off:.0f} ms")
    if off is not None and off.done() and dialogue.reading.mode not in (Mode.DISARMED, Mode.FAULT):
        problems.append(f"motor off was answered, and the state is {dialogue.reading.mode.name}")
    return Stop(line.name, word, switched_off, tuple(problems))


def interleavings(number: int, seed: int) -> Iterator[Stop]:
    """Yield what became of each of `number` stops; the same for the same seed."""
    with tempfile.TemporaryDirectory() as folder, Emulator(Path(folder) / "board", height=0.98) as emulator:
        host = Host(emulator)
        for place in range(number):
            yield interleaving(host, random.Random(seed * 1_000_003 + place))
