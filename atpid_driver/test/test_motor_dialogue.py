# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stops over any interleaving of requests, delays and losses, against a model of the firmware in virtual time."""

from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import settings as example_settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from motor_rigs import words

from atpid_common.vocabulary import Mode
from atpid_driver import NotReadyError
from atpid_driver.motor.dialogue import CONFIRM_TIME, LINK_TIME, NO_LINK, STOP_REPEAT, Dialogue
from atpid_driver.motor.faults import NO_FAULT, LinkError, MotorFault
from atpid_driver.motor.protocol import decode, encode
from atpid_driver.motor.settings import MotorSettings

SETTINGS = MotorSettings(backend="serial", lowest=0.017, highest=1.0, speed=0.3, port="board")
STEP = 0.005
MOVING_WORDS = ("MOVE", "HOME")


class ModelBoard:
    """The firmware's rules of sequence, mode and heartbeat (docs/motor_protocol.md), and a ceiling of one speed."""

    def __init__(self) -> None:
        self.mode, self.faults, self.last, self.rejected = Mode.DISARMED, 0, 0, 0
        self.open, self.homed, self.height, self.target = False, True, 500_000.0, 500_000
        self.beat = self.now = 0.0
        self.executed: list[tuple[float, str, int]] = []  # what moves: when, word, target

    @property
    def motor_on(self) -> bool:
        return self.mode in (Mode.MOVING, Mode.HOMING)

    def advance(self, now: float) -> None:
        way, self.now = 300_000.0 * (now - self.now), now
        if self.mode is Mode.MOVING:
            left = self.target - self.height
            self.height += max(-way, min(way, left))
            if abs(self.target - self.height) < 1.0:
                self.mode = Mode.HOLDING
        if self.mode in (Mode.HOLDING, Mode.MOVING, Mode.HOMING) and now - self.beat > 0.48:
            self.mode, self.faults = Mode.FAULT, 1

    def answer(self, data: bytes) -> bytes | None:
        try:
            frame = decode(data)
        except Exception:  # counted and dropped, as the firmware does
            self.rejected += 1
            return None
        sequence, word = frame.sequence, frame.word
        if word == "ID":
            self.mode = Mode.FAULT if self.mode is Mode.FAULT else Mode.DISARMED
            self.open, self.last = True, sequence
            return encode(sequence, "ID", "ATPID-MOTOR", "1.1.0", 1, 1, "POWER", 17000, 1000000, 300000, 0)
        ahead = (sequence - self.last + 32768) % 65536 - 32768
        if not self.open or ahead < 0:
            return encode(sequence, "NO", "OLD" if self.open else "SESSION")
        if ahead:
            self.last = sequence
            if refusal := self._act(word, [int(text) for text in frame.arguments]):
                return encode(sequence, "NO", refusal)
        height = str(round(self.height)) if self.homed else "-"
        has_target = self.mode in (Mode.HOLDING, Mode.MOVING)
        return encode(
            sequence, "ST", int(self.mode), int(self.homed), f"{self.faults:04X}", height,
            str(self.target) if has_target else "-", 5000, round(self.now * 1e3), self.rejected, self.last,
        )  # fmt: skip

    def _act(self, word: str, numbers: list[int]) -> str:
        armed = self.mode in (Mode.HOLDING, Mode.MOVING)
        if word in ("BEAT", "ARM", "MOVE"):
            self.beat = self.now
        if word == "DISARM" and armed:
            self.mode = Mode.DISARMED
        elif word == "ARM" and not armed:
            self.mode, self.faults, self.target = Mode.HOLDING, 0, round(self.height)
        elif word in ("STOP", "MOVE") and not armed:
            return "FAULT" if self.mode is Mode.FAULT else "DISARMED"
        elif word == "STOP":
            self.mode, self.target = Mode.HOLDING, round(self.height)
        elif word == "MOVE" and (self.mode is not Mode.MOVING or self.target != numbers[0]):
            self.executed.append((self.now, word, numbers[0]))
            self.mode, self.target = Mode.MOVING, numbers[0]
        return ""


class Stops(RuleBasedStateMachine):
    """Wishes in any order at any time, on a line that delays, loses and garbles as it is told."""

    @initialize()
    def connect(self) -> None:
        self.now, self.board, self.dialogue = 0.0, ModelBoard(), Dialogue(SETTINGS)
        self.to_board: list[tuple[float, bytes]] = []
        self.to_host: list[tuple[float, bytes]] = []
        self.delay, self.fates = 0.0, [0]  # of the next frames, in turn: 0 passes, 1 lost, 2 garbled
        self.count = 0
        self.stop_called: float | None = None  # while no later height is wanted
        self.off: Future[None] | None = None
        self.written: list[tuple[float, str]] = []
        self.dialogue.opened(self.now)
        self.run(0.1)
        assert self.dialogue.ready

    def passed(self, data: bytes, waiting: list[tuple[float, bytes]]) -> None:
        fate = self.fates[self.count % len(self.fates)]
        self.count += 1
        if fate == 2:
            data = data.replace(b"*", b"+")
        if fate != 1:
            waiting.append((max(self.now + self.delay, waiting[-1][0] if waiting else 0.0), data))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.turn()
            self.now += STEP
            self.board.advance(self.now)

    def turn(self) -> None:
        """Let the host write, the line deliver and the board answer."""
        try:
            while (frame := self.dialogue.due(self.now)) is not None:
                word = decode(frame).word
                self.written.append((self.now, word))
                if self.dialogue.stopping:
                    assert word in ("STOP", "DISARM", "ID"), "while a stop is not confirmed nothing else is written"
                self.passed(frame, self.to_board)
            for waiting, to_board in ((self.to_board, True), (self.to_host, False)):
                while waiting and waiting[0][0] <= self.now:
                    data = waiting.pop(0)[1]
                    if not to_board:
                        self.dialogue.read(data, self.now)
                    elif (answer := self.board.answer(data)) is not None:
                        self.passed(answer, self.to_host)
        except LinkError as error:
            self.dialogue.lost(error)
            self.dialogue.opened(self.now)
            self.to_board.clear()
            self.to_host.clear()

    def drive(self, seconds: float) -> None:
        """Let time pass while the caller reads."""
        for _ in range(round(seconds / STEP)):
            self.dialogue.keep_alive(self.now)
            self.run(STEP)

    def go(self, height: int, sequence: int = 1) -> None:
        self.dialogue.move(height, sequence, self.now)

    def reported(self, *named: str) -> bool:
        """Whether an event since the last call has these words."""
        return any(set(named) <= words(text) for text in self.dialogue.reports())

    @rule(seconds=st.floats(0.0, 0.4), fates=st.lists(st.sampled_from([0, 0, 0, 1, 2]), min_size=1, max_size=7))
    def time_passes(self, seconds: float, fates: list[int]) -> None:
        self.fates = fates
        self.run(seconds)

    @rule(delay=st.floats(0.0, 0.3))
    def the_line_delays(self, delay: float) -> None:
        self.delay = delay

    @rule()
    def the_caller_reads(self) -> None:
        self.dialogue.keep_alive(self.now)

    @rule()
    def arm(self) -> None:
        self.off = None
        self.dialogue.arm(self.now)

    @precondition(lambda self: self.dialogue.reading.ready and self.dialogue.heartbeat)
    @rule(height=st.integers(17_000, 1_000_000))
    def move(self, height: int) -> None:
        self.dialogue.keep_alive(self.now)
        self.dialogue.move(height, 1, self.now)
        if not self.dialogue.stopping:
            self.stop_called = None

    @rule()
    def hold(self) -> None:
        self.dialogue.hold(2, self.now)
        self.stopped()

    @rule()
    def disarm(self) -> None:
        self.off = self.dialogue.disarm(self.now)
        self.stopped()

    def stopped(self) -> None:
        """A stop is on the wire at once, whatever is outstanding, and then again and again."""
        self.stop_called = self.now
        if self.dialogue.stopping and self.dialogue.identified:
            recent = self.now - STOP_REPEAT
            before = len(self.written)
            self.turn()
            words = {word for when, word in self.written if when > recent} | {word for _, word in self.written[before:]}
            assert words & {"STOP", "DISARM"} or not self.dialogue.identified

    @invariant()
    def a_confirmed_stop_is_true(self) -> None:
        """What the caller is answered is the board's state."""
        confirmed = self.stop_called is not None and not self.dialogue.stopping
        if confirmed or (self.off is not None and self.off.done()):
            assert not self.board.motor_on

    @invariant()
    def no_height_from_before_a_stop_is_taken_up_after_it(self) -> None:
        """On the line in order: what arrives after the stop's own frame."""
        if self.stop_called is not None and self.dialogue.stopping:
            assert all(word not in MOVING_WORDS for when, word in self.written if when > self.stop_called)

    def teardown(self) -> None:
        """On a line that passes everything again, every stop is confirmed soon, and nothing moves."""
        off = self.dialogue.disarm(self.now)
        self.fates, self.delay = [0], 0.0
        self.run(LINK_TIME + 1.0)
        assert off.done()
        assert not self.board.motor_on


Stops.TestCase.settings = example_settings(max_examples=150, stateful_step_count=30, deadline=None)
TestStops = pytest.mark.filterwarnings("default")(Stops.TestCase)


@pytest.fixture
def armed() -> Stops:
    machine = Stops()
    machine.connect()
    machine.dialogue.arm(machine.now)
    machine.run(0.1)
    machine.dialogue.keep_alive(machine.now)
    assert machine.dialogue.reading.mode is Mode.HOLDING
    return machine


@pytest.fixture
def moving(armed: Stops) -> Stops:
    """On its way down."""
    armed.go(100_000)
    armed.drive(0.1)
    assert armed.board.mode is armed.dialogue.reading.mode is Mode.MOVING
    return armed


@pytest.mark.parametrize("late", [0.0, 0.014, 0.016, 0.025, 0.1, 0.3])
@pytest.mark.parametrize("word", ["STOP", "DISARM"])
def test_however_late_the_answers_a_stop_is_written_at_once(armed: Stops, late: float, word: str) -> None:
    """As behind a USB chip that holds short answers back for 16 ms."""
    armed.delay = late
    armed.go(100_000)
    armed.drive(0.7)
    assert armed.board.mode is Mode.MOVING
    before = len(armed.written)
    called = armed.now
    armed.dialogue.hold(2, called) if word == "STOP" else armed.dialogue.disarm(called)
    armed.turn()
    assert armed.written[before] == (called, word)
    armed.drive(late + 2 * STEP)
    assert not armed.board.motor_on


def test_a_stop_right_after_a_move_whose_answer_has_not_come(armed: Stops) -> None:
    armed.delay = 0.05
    armed.go(100_000)
    armed.turn()
    armed.dialogue.hold(2, armed.now)
    armed.drive(0.4)
    assert [word for _, word in armed.written if word in ("MOVE", "STOP")][:2] == ["MOVE", "STOP"]
    assert armed.board.mode is Mode.HOLDING
    assert armed.board.height > 470_000
    assert (armed.dialogue.goal, armed.dialogue.reading.sequence) == (None, 2)


def test_an_answer_to_an_earlier_request_does_not_show_a_ceiling_at_rest(armed: Stops) -> None:
    """On a very late line a height is given up before it is answered; the board carries it out all the same."""
    armed.delay = 0.3
    armed.drive(0.9)
    armed.go(100_000)
    armed.drive(0.56)
    assert armed.dialogue.goal is None, "given up"
    assert armed.dialogue.reading.mode is Mode.HOLDING, "an answer to a request from before"
    assert armed.board.motor_on
    armed.dialogue.hold(2, armed.now)
    armed.drive(0.4)
    assert armed.board.mode is Mode.HOLDING


def test_an_answer_that_shows_the_motor_on_confirms_no_stop(moving: Stops) -> None:
    """Whatever the reason: a board with another firmware, a frame that was taken for another one."""
    off = moving.dialogue.disarm(moving.now)
    for _ in range(3):
        moving.now += STOP_REPEAT
        frame = moving.dialogue.due(moving.now)
        assert frame is not None
        sequence = decode(frame).sequence
        height, uptime = round(moving.board.height), round(moving.now * 1e3)
        state = encode(sequence, "ST", 4, 1, "0000", height, 100000, 5000, uptime, 0, sequence)
        moving.dialogue.read(state, moving.now)
        assert not off.done()
        assert moving.dialogue.stopping


@pytest.mark.parametrize("word", ["STOP", "DISARM"])
def test_a_stop_discards_a_height_that_was_not_written_yet(armed: Stops, word: str) -> None:
    armed.go(100_000)
    armed.dialogue.hold(2, armed.now) if word == "STOP" else armed.dialogue.disarm(armed.now)
    assert armed.dialogue.goal is None
    armed.drive(0.3)
    assert armed.board.executed == []


def test_armed_after_the_board_had_stopped_itself_unread_the_same_height_is_sent_again(moving: Stops) -> None:
    """The host hung for longer than the heartbeat, and was armed before it read the fault."""
    moving.now += 0.6
    moving.board.advance(moving.now)
    assert moving.board.mode is Mode.FAULT
    moving.dialogue.arm(moving.now)
    moving.go(100_000, 2)
    moving.drive(0.3)
    assert [target for _, _, target in moving.board.executed] == [100_000, 100_000]


def test_a_height_after_a_stop_waits_until_that_is_confirmed(moving: Stops) -> None:
    moving.delay = 0.1
    moving.dialogue.hold(2, moving.now)
    moving.go(800_000, 3)
    moving.drive(0.15)
    assert moving.board.mode is Mode.HOLDING
    moving.drive(0.3)
    assert [target for _, _, target in moving.board.executed] == [100_000, 800_000]
    assert moving.dialogue.reading.sequence == 3


def test_a_height_that_the_line_lost_is_sent_again_and_one_that_stays_unanswered_may_be_commanded_again(
    armed: Stops,
) -> None:
    armed.fates = [1]
    armed.go(100_000)
    armed.drive(0.3)
    armed.fates = [0]
    armed.drive(0.1)
    assert [target for _, _, target in armed.board.executed] == [100_000]
    armed.fates = [1]
    armed.go(800_000, 2)
    armed.drive(0.55)
    assert armed.dialogue.goal is None
    assert armed.reported("not", "answer", "MOVE")


def test_a_stop_that_is_not_confirmed_is_reported_and_goes_on_over_a_lost_link(moving: Stops) -> None:
    moving.fates = [1]
    off = moving.dialogue.disarm(moving.now)
    moving.drive(0.6)
    assert moving.reported("DISARM", "not", "confirmed", f"{CONFIRM_TIME:g}")
    moving.drive(1.0)
    assert not off.done()
    moving.dialogue.reports()
    moving.fates = [0]
    moving.drive(0.5)
    assert off.done()
    assert moving.reported("DISARM", "confirmed", "after")
    assert moving.dialogue.reading.mode in (Mode.DISARMED, Mode.FAULT)


def test_a_stop_ends_arming(armed: Stops) -> None:
    armed.dialogue.disarm(armed.now)
    armed.drive(0.1)
    armed.delay = 0.05
    done = armed.dialogue.arm(armed.now)
    armed.turn()
    armed.dialogue.disarm(armed.now)
    with pytest.raises(NotReadyError, match="stop"):
        done.result(timeout=0)
    armed.drive(0.5)
    assert armed.board.mode is Mode.DISARMED


def test_a_board_at_rest_is_not_asked_to_hold(armed: Stops) -> None:
    before = len(armed.written)
    armed.dialogue.hold(2, armed.now)
    armed.drive(0.2)
    assert {word for _, word in armed.written[before:]} == {"BEAT"}


def test_an_identity_that_was_never_answered_costs_no_link() -> None:
    """A bootloader discards requests; those that it did are not waited for once the board is identified."""
    machine = Stops()
    machine.connect()
    machine.dialogue.opened(machine.now)
    machine.count, machine.delay = 0, 0.3  # the second request is made before the first is answered, and lost
    machine.fates = [0, 1, 0, 0, 0, 0, 0, 0, 0, 0]
    machine.run(0.7)
    machine.fates, machine.delay = [0], 0.0
    machine.run(1.5)
    assert machine.dialogue.ready
    assert machine.dialogue.counts()["connections"] == "2"


def test_switched_off_after_a_hold_that_is_not_confirmed_it_is_off_and_not_only_at_rest(moving: Stops) -> None:
    moving.delay = 0.05
    moving.dialogue.hold(2, moving.now)
    off = moving.dialogue.disarm(moving.now)
    moving.drive(0.4)
    assert off.done()
    assert moving.board.mode is moving.dialogue.reading.mode is Mode.DISARMED
    assert not moving.dialogue.heartbeat


def test_without_its_caller_the_heartbeat_ends(moving: Stops) -> None:
    moving.run(0.25 + 0.5)
    assert (moving.board.mode, moving.board.faults) == (Mode.FAULT, MotorFault.HEARTBEAT)


def test_a_board_that_does_not_answer_is_a_lost_link_which_stays_until_it_is_armed(armed: Stops) -> None:
    armed.fates = [1]
    armed.drive(LINK_TIME + 0.2)
    assert armed.dialogue.reading == replace(NO_LINK, faults=MotorFault.LINK_LOST)
    assert armed.reported("no", "answer")
    armed.fates = [0]
    armed.drive(1.0)
    assert armed.dialogue.reading.mode is Mode.FAULT
    assert MotorFault.LINK_LOST in armed.dialogue.reading.faults
    armed.dialogue.arm(armed.now)
    armed.drive(0.2)
    assert (armed.dialogue.reading.mode, armed.dialogue.reading.faults) == (Mode.HOLDING, NO_FAULT)


def test_a_height_that_the_motor_cannot_have_reached_is_no_answer_of_the_board(armed: Stops) -> None:
    armed.board.height -= 100_000
    armed.drive(0.3)
    assert armed.reported("0.5000", "0.4000", "m")
    assert MotorFault.LINK_LOST in armed.dialogue.reading.faults
    assert armed.board.mode is Mode.DISARMED, "by the new session"
    assert armed.dialogue.reading.mode is Mode.FAULT, "until a person arms it"


def test_a_height_that_a_restarted_board_refuses_is_a_lost_session(armed: Stops) -> None:
    """It is identified again."""
    armed.board.open = False
    armed.go(100_000)
    armed.drive(3 * STEP)
    assert MotorFault.LINK_LOST in armed.dialogue.reading.faults
    assert not armed.reported("refused", "MOVE")
    armed.drive(0.1)
    assert armed.dialogue.ready
    assert armed.dialogue.counts()["connections"] == "2"


def test_a_reading_has_the_steady_time_at_which_the_board_took_it() -> None:
    """Of a clock that loses 60 ppm, over a line of 3 to 30 ms: within half of the shortest round trip."""
    random, board, dialogue = np.random.default_rng(6), ModelBoard(), Dialogue(SETTINGS)
    dialogue.opened(100.0)
    off, trips, now = [], [], 100.0
    while now < 200.0:
        if (frame := dialogue.due(now)) is not None:
            there, back = 0.003 + random.exponential(0.002, 2)
            board.advance((now + there - 100.0) * (1.0 - 60e-6) + 7.0)
            answer = board.answer(frame)
            assert answer is not None
            dialogue.read(answer, now + there + back)
            off.append(dialogue.reading.steady - now - there)
            trips.append(there + back)
            now += there + back
        now += STEP
    assert np.isnan(off[0])  # the identity has no height
    assert np.abs(off[200:]).max() < 0.5 * min(trips) + 1e-3
    counts = dialogue.counts()
    assert float(counts["stamps within [s]"]) == pytest.approx(0.5 * min(trips), rel=0.1)
    assert float(counts["clock drift [ppm]"]) == pytest.approx(60.0, abs=30.0)
