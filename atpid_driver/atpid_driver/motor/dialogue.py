# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is written to the board and when, decided from what is wanted and what it answered; without I/O.

**A stop is a state, not a command in a queue.** From the moment `hold` or `disarm` returns until the board's answer
confirms it, the only frames returned by `due` are STOP or DISARM: the first at once, whatever is outstanding, then
again every `STOP_REPEAT`. Nothing expires it, refuses it or overtakes it, a height that was wanted before is discarded,
and it outlasts a lost connection. So no answer that is late or lost delays a stop, and no MOVE follows it.
Times are of the steady clock [s].
"""

from collections import deque
from concurrent.futures import Future
from dataclasses import replace
from math import inf
from typing import Final

from atpid_common.vocabulary import Mode
from atpid_driver import DriverError, NotReadyError
from atpid_driver.clock import DeviceClock
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.faults import NO_FAULT, LinkError, MotorFault, in_words
from atpid_driver.motor.protocol import NAME, IdentityReply, Refusal, Reply, StateReply
from atpid_driver.motor.session import (
    Arming,
    MotorAnswer,
    MotorRequest,
    MotorSession,
    Move,
    SessionLostError,
    Stop,
    check_identity,
)
from atpid_driver.motor.settings import MotorSettings

NO_LINK: Final = Reading(Mode.UNCONFIGURED)
#: The heartbeat goes on for so long after the caller's last sign of life.
_KEEP_ALIVE_TIME: Final = 0.25
#: Between two frames of a stop that is not confirmed: often, since a lost frame must not delay it.
STOP_REPEAT: Final = 0.02
#: A stop that is not confirmed for so long is reported; it goes on. Longer than the firmware's heartbeat.
CONFIRM_TIME: Final = 0.55
#: Between two requests for the identity.
_IDENTIFY_REPEAT: Final = 0.25
#: Another request is made without an answer after so many round trips, within these bounds.
_PATIENCE, _SHORTEST, _LONGEST = 1.3, 0.04, 0.2
#: With a request that is older than this, and no answer to it or to a later one, the link is lost.
LINK_TIME: Final = 1.0
#: An answer that takes longer is reported, and so that for so long none did.
_LATE, _AGAIN = 0.2, 2.0
#: Heights of two answers may differ by this share more than the motor moves [-], and by so much more [m].
_FASTER, _PLAY = 1.5, 0.003
_IN_MOTION = (Mode.HOMING, Mode.MOVING)
_OFF = (Mode.DISARMED, Mode.FAULT)


class Dialogue:
    """One board over all its connections. `reading`: last state; `goal`: height on its way or taken [µm]."""

    def __init__(self, settings: MotorSettings) -> None:
        self._settings = settings
        self._session = MotorSession()
        self._opened = self._next = self._poll_at = self._round_trip = 0.0
        self._clock, self._least_trip = DeviceClock(), inf  # of the board; its readings lie within a round trip [s]
        self._late_until = 0.0  # 0: answers come in time
        self._kept_alive = -inf
        self._sequence = 0  # of the last command carried out
        self._moving: MotorRequest | None = None  # the last that moves, until a later answer shows the ceiling at rest
        self._stop: Stop | None = None
        self._arming: Arming | None = None
        self._move: Move | None = None
        self._taken: StateReply | None = None  # last state of this session
        self._latched = NO_FAULT  # faults of the link, until the board has accepted ARM
        self._reports: deque[str] = deque(maxlen=32)
        self._connections = self._garbled = self._repeated = self._rejected = 0
        self._slowest_stop = 0.0
        self.identified = False  # in this connection
        self.identity: IdentityReply | None = None  # of the last one
        self.last_error = self._found_again = ""
        self.reading = NO_LINK
        self.goal: int | None = None
        self.heartbeat = False  # whether to send one

    # -- what is wanted --------------------------------------------------------------------------------------------

    def keep_alive(self, now: float) -> None:
        """Note that the caller still runs: the heartbeat continues for _KEEP_ALIVE_TIME."""
        self._kept_alive = now

    def hold(self, sequence: int | None, now: float) -> None:
        """Stop the ceiling where it is. Nothing is written where no frame that moves it can be on its way."""
        self.goal = self._move = None
        if self._stop is None and (self._moving is not None or self.reading.mode in _IN_MOTION):
            self._stop = Stop("STOP", sequence, now)

    def disarm(self, now: float) -> "Future[None]":
        """Stop and switch the motor off; the result is there once the board has confirmed it."""
        self.heartbeat, self.goal, self._move = False, None, None
        self.end_arming(NotReadyError("a stop came before the board was armed"))
        if self._stop is None or self._stop.word != "DISARM":
            earlier, self._stop = self._stop, Stop("DISARM", None, now)
            if earlier is not None:
                earlier.confirmed.set_result(None)  # no caller waits for a hold
        return self._stop.confirmed

    def arm(self, now: float) -> "Future[None]":
        """Arm, and home where the reference is lost; a stop that is not confirmed comes first."""
        self.keep_alive(now)
        self.heartbeat, self.goal, self._move = True, None, None  # the board may have stopped, unread, on its way
        self.end_arming(NotReadyError("armed again meanwhile"))
        self._arming = Arming(["ARM"] if self.reading.homed else ["ARM", "HOME"])
        return self._arming.done

    def move(self, target: int, sequence: int, now: float) -> None:
        """Travel to `target` [µm], the newest only; what is on its way there already is not sent again."""
        if target != self.goal:
            self.goal, self._move = target, Move(target, sequence, now)

    def reports(self) -> list[str]:
        """Return the events since the last call, one line each."""
        return [self._reports.popleft() for _ in range(len(self._reports))]

    def counts(self) -> dict[str, str]:
        """Return counters for diagnostics."""
        return {
            "connections": str(self._connections),
            "garbled answers": str(self._garbled + self._session.garbled),
            "repeated requests": str(self._repeated + self._session.repeated),
            "frames refused by board": str(self._rejected),
            "round trip [ms]": f"{1e3 * self._round_trip:.1f}",
            "slowest stop until confirmed [ms]": f"{1e3 * self._slowest_stop:.0f}",
            "clock drift [ppm]": f"{self._clock.drift_ppm:.2f}",
            "stamps within [s]": f"{0.5 * self._least_trip:.2g}",
        }

    # -- the connection --------------------------------------------------------------------------------------------

    def opened(self, now: float) -> None:
        """Begin a session on a port that was opened, or with a board that must be identified again."""
        self._garbled, self._repeated = self._garbled + self._session.garbled, self._repeated + self._session.repeated
        self._session, self._taken, self.identified = MotorSession(), None, False
        self._opened, self._round_trip = now, 0.0
        self._clock, self._least_trip = DeviceClock(), inf

    def lost(self, error: DriverError) -> None:
        """Discard the state, latch the loss if the motor was armed, report the error once. A stop remains."""
        self.identified = False
        self._latched |= MotorFault.LINK_LOST if self.heartbeat else NO_FAULT
        self.reading, self.goal, self._move = replace(NO_LINK, faults=self._latched), None, None
        self.end_arming(error)
        if str(error) != self.last_error:
            self.report(str(error))

    def closed(self) -> None:
        """Forget what belongs to a connection that its owner has ended."""
        self.identified, self._stop, self._moving = False, None, None
        self.reading, self._latched = NO_LINK, NO_FAULT

    @property
    def ready(self) -> bool:
        """Whether the board is identified and has given its state."""
        return self.identified and self._taken is not None

    @property
    def stopping(self) -> bool:
        """Whether a stop is not confirmed yet."""
        return self._stop is not None

    def due(self, now: float) -> bytes | None:
        """Return the frame to write now, if any; `wait` then returns for how long none is due unless a line is read.

        Raises `LinkError` where the board does not answer.
        """
        if not self.identified:
            return self._due_identity(now)
        unanswered = self._session.unanswered
        if unanswered is not None and now - unanswered.asked > LINK_TIME:
            raise LinkError(f"no answer to {unanswered.word} within {LINK_TIME:g} s")
        if self._stop is not None:
            return self._due_stop(self._stop, now)
        if self._arming is not None and self._arming.refused is None:
            return self._due_request(now, self._arming.words[0])
        if self._move is not None and (frame := self._due_move(self._move, now)):
            return frame
        return None if self._move is not None else self._due_poll(now)

    def wait(self, now: float) -> float:
        """Return after which time `due` is to be asked again [s]."""
        return max(0.0, self._next - now)

    def _due_identity(self, now: float) -> bytes | None:
        """Opening the port restarts a board, whose bootloader discards bytes: a new request each time."""
        if now - self._opened > self._settings.identify_timeout:
            raise LinkError(
                f"nothing answers as {NAME} within {self._settings.identify_timeout:g} s: is the firmware flashed, "
                "the baud rate right?"
            )
        request, repeat = self._session.request, STOP_REPEAT if self._stop else _IDENTIFY_REPEAT  # ID disarms, too
        due = now if request is None else request.written + repeat
        self._next = due if now < due else now + repeat
        return self._session.begin(now, "ID") if now >= due else None

    def _due_stop(self, stop: Stop, now: float) -> bytes | None:
        if not stop.reported and now - stop.since > CONFIRM_TIME:
            stop.reported = True
            self.report(f"{stop.word} not confirmed by the board within {CONFIRM_TIME:g} s: it goes on being sent")
        return self._due_request(now, stop.word, patience=STOP_REPEAT)

    def _due_move(self, move: Move, now: float) -> bytes | None:
        waited = now - move.received
        if waited > self._settings.command_timeout:
            self.goal = self._move = self._session.request = None
            self.report(f"the board did not answer MOVE within {waited:.2f} s: it is not sent any longer")
            return None
        return self._due_request(now, "MOVE", move.target)

    def _due_request(self, now: float, word: str, *arguments: int, patience: float = 0.0) -> bytes | None:
        """Return a request that is not outstanding yet, or that waits for its answer for too long."""
        request, patience = self._session.request, patience or self._patience
        if request is None or request.word != word or request.arguments != arguments:
            frame: bytes | None = self._session.begin(now, word, *arguments)
        else:
            frame = self._again(now, request) if now >= request.written + patience else None
        request = self._session.request
        assert request is not None
        if word in ("MOVE", "HOME"):
            self._moving = request
        self._next = request.written + patience
        return frame

    def _again(self, now: float, request: MotorRequest) -> bytes:
        """A height goes out as a new request, which is a heartbeat too; any other request is carried out once."""
        if request.word == "MOVE":
            return self._session.begin(now, request.word, *request.arguments)
        return self._session.repeat(now)

    def _due_poll(self, now: float) -> bytes | None:
        request = self._session.request
        due = self._poll_at if request is None else request.written + self._patience
        if now < due:
            self._next = due
            return None
        self._poll_at = max(self._poll_at + 1.0 / self._settings.rate, now)
        self._next = self._poll_at
        alive = self.heartbeat and now - self._kept_alive < _KEEP_ALIVE_TIME
        return self._session.begin(now, "BEAT" if alive else "STATE")

    @property
    def _patience(self) -> float:
        """How long to wait for an answer [s]: a lost frame must not cost a heartbeat, a late one no second request."""
        return min(max(_PATIENCE * self._round_trip, _SHORTEST), _LONGEST)

    # -- what the board answers ------------------------------------------------------------------------------------

    def read(self, line: bytes, now: float) -> None:
        """Take a line of the board. Raises `SessionLostError`, or what `check_identity` raises."""
        answer = self._session.answer(line)
        if answer is None:
            return
        if not self.identified:
            if isinstance(answer.reply, IdentityReply):
                self._identify(answer.reply, now)
            return
        self._judge_delay(answer.request, now)
        if isinstance(answer.reply, StateReply):
            self._clock.add(answer.reply.uptime, now)
            taken = self._clock.steady(answer.reply.uptime) - 0.5 * self._least_trip
            # whatever the board's clock is, it was after the request and before the answer
            self._take(answer.reply, min(max(taken, answer.request.asked), now))
            if self._moving and self._moving.not_after(answer.request) and answer.reply.mode not in _IN_MOTION:
                self._moving = None
        elif answer.reply in (Refusal("SESSION"), Refusal("OLD")):
            raise SessionLostError(f"the board no longer follows: {answer.reply}; it is identified again")
        if self._move is not None and self._move.asked_by(answer.request):
            self._conclude_move(self._move, answer.reply)
        if answer.outstanding:
            self._conclude(answer, now)

    def _identify(self, identity: IdentityReply, now: float) -> None:
        check_identity(identity, self._settings.limits)
        before, self.identity, self.identified = self.identity, identity, True
        self._session.forget()
        self._moving, self._poll_at = None, now
        self._connections += 1
        restarted = before is not None and before.boots != identity.boots
        if restarted and self.heartbeat:
            self._latched |= MotorFault.RESTARTED
        if before is not None:
            how = f", restarted ({identity.reset_cause})" if restarted else ""
            self._found_again = f"board found again at {self._settings.port}{how}; motor off"

    def _conclude(self, answer: MotorAnswer, now: float) -> None:
        """Conclude from the answer to the outstanding request what became of what was wanted."""
        word, self._session.request = answer.request.word, None
        if self._stop is not None and word == self._stop.word:
            self._conclude_stop(self._stop, answer.reply, now)
        elif self._arming is not None and (word == self._arming.words[0] or self._arming.refused):
            self._conclude_arming(self._arming, answer.reply, now)
        elif isinstance(answer.reply, Refusal) and word in ("BEAT", "STATE"):
            raise SessionLostError(f"the board no longer follows: {answer.reply}; it is identified again")

    def _conclude_stop(self, stop: Stop, reply: Reply, now: float) -> None:
        """A board that refuses to stop because it is disarmed or in a fault is at rest, too."""
        if isinstance(reply, StateReply):
            at_rest = reply.mode in _OFF if stop.word == "DISARM" else reply.mode not in _IN_MOTION
        else:
            at_rest = stop.word == "STOP"
        if not at_rest:
            return  # the next request is made at once
        self._stop = self._moving = None
        self._slowest_stop = max(self._slowest_stop, now - stop.since)
        self._sequence = self._sequence if stop.sequence is None else stop.sequence
        self.reading = replace(self.reading, sequence=self._sequence)
        stop.confirmed.set_result(None)
        if stop.reported:
            self.report(f"{stop.word} confirmed by the board after {now - stop.since:.2f} s")

    def _conclude_arming(self, arming: Arming, reply: Reply, now: float) -> None:
        if arming.refused is not None:
            faults = f" ({in_words(self.reading.faults)})" if self.reading.faults else ""
            self.end_arming(NotReadyError(f"the board refused {arming.words[0]}: {arming.refused}{faults}"))
        elif isinstance(reply, Refusal):
            arming.refused, self._poll_at = reply, now
        else:
            if arming.words.pop(0) == "ARM":
                self._latched = NO_FAULT
                assert self._taken is not None
                self.reading = replace(self.reading, mode=self._taken.mode, faults=self._taken.faults)
            if not arming.words:
                self._arming = None
                arming.done.set_result(None)

    def _conclude_move(self, move: Move, reply: Reply) -> None:
        self._move = None
        if isinstance(reply, Refusal):
            self.goal = None
            self.report(f"the board refused MOVE: {reply}")
            return
        self._sequence = move.sequence
        self.reading = replace(self.reading, sequence=self._sequence)

    def end_arming(self, error: DriverError) -> None:
        """Give up arming, with the reason for who waits for it."""
        arming, self._arming = self._arming, None
        if arming is not None:
            arming.done.set_exception(error)

    def _judge_delay(self, request: MotorRequest, now: float) -> None:
        """Take an answer's time; report when answers begin to come late, and when they come in time again."""
        waited = now - request.asked
        if request.repeated:
            return  # it is not known which of them was answered
        self._round_trip, self._least_trip = waited, min(waited, self._least_trip)
        if waited > _LATE:
            if not self._late_until:
                self.report(f"the board answers late, after {waited:.2f} s: the height reported is as old")
            self._late_until = now + _AGAIN
        elif self._late_until and now > self._late_until:
            self._late_until = 0.0
            self.report(f"the board answers within {_LATE:g} s again")

    def _check_plausible(self, reply: StateReply) -> None:
        """Raise `SessionLostError` for a height that this motor cannot have reached: the answer is not the board's."""
        before, self._taken = self._taken, reply
        if before is None or reply.faults or not (before.homed and reply.homed):
            return
        elapsed = max(0.0, reply.uptime - before.uptime)
        if abs(reply.height - before.height) > _FASTER * self._settings.speed * elapsed + _PLAY:
            raise SessionLostError(
                f"the board's answers go from {before.height:.4f} to {reply.height:.4f} m in {elapsed:.3f} s, which "
                "its motor cannot: it is identified again"
            )

    def _take(self, reply: StateReply, steady: float) -> None:
        self._check_plausible(reply)
        velocity = self._settings.speed if reply.target > reply.height else -self._settings.speed
        self._rejected = reply.rejected
        if reply.mode not in (Mode.MOVING, Mode.HOLDING):
            self.goal = self._move = None
        self.reading = Reading(
            mode=Mode.FAULT if self._latched else reply.mode,
            homed=reply.homed,
            faults=reply.faults | self._latched,
            height=reply.height,
            target=reply.target,
            velocity=velocity if reply.mode is Mode.MOVING else 0.0,
            speed=self._settings.speed,
            sequence=self._sequence,
            time=reply.uptime,
            steady=steady,
        )
        if self._found_again:
            until = f" until ~/rearm: {in_words(self.reading.faults)}" if self.reading.faults else ""
            self.report(self._found_again + until)
            self._found_again = ""

    def report(self, text: str) -> None:
        """Add an event, which is also the last error."""
        self.last_error = text
        self._reports.append(text)
