# SPDX-License-Identifier: Apache-2.0
"""The I/O thread to the board: opens, identifies, polls, carries out jobs, reconnects with backoff.

It starts no motion by itself: every command but the poll comes from `submit`. An interruption while the motor is armed
is latched as a fault, since opening the port restarts a board and with it what the board had latched.
"""

import queue
import threading
import time
from collections import deque
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Final

from atpid_common.injected_faults import Injected
from atpid_driver.motor.ceiling_actuator import Mode, Reading
from atpid_driver.motor.errors import CommandStaleError, LinkError, MotorError, NotReadyError
from atpid_driver.motor.faults import NO_FAULT, Fault, in_words
from atpid_driver.motor.faulty_port import FaultyPort
from atpid_driver.motor.protocol import IdentityReply, Refusal, StateReply
from atpid_driver.motor.serial_port import SerialPort
from atpid_driver.motor.session import Session, SessionLostError, check_identity
from atpid_driver.motor.settings import MotorSettings

NO_LINK: Final = Reading(Mode.UNCONFIGURED)
KEEP_ALIVE_TIME: Final = 0.25
QUEUE: Final = 8
FIRST_WAIT, LONGEST_WAIT = 0.1, 5.0
#: An answer that takes longer is reported [s], and so that for so long none did [s].
LATE, AGAIN = 0.2, 2.0
#: Heights of two answers may differ by this share more than the motor moves [-], and by so much more [m].
FASTER, PLAY = 1.5, 0.003


@dataclass(slots=True)
class Job:
    """Commands to be carried out one after the other, when they were queued, and their outcome."""

    commands: tuple[tuple[str, tuple[int, ...]], ...]
    sequence: int | None = None
    awaited: bool = False
    received: float = field(default_factory=time.monotonic)
    done: Future[None] = field(default_factory=Future)


class Link:
    """Owns the port. `reading`: last state; `goal`: last height requested [µm]; `heartbeat`: whether to send one."""

    def __init__(self, settings: MotorSettings) -> None:
        self._settings = settings
        self._jobs: queue.Queue[Job] = queue.Queue(QUEUE)
        self._reports: deque[str] = deque(maxlen=32)
        self._stop, self._ended = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._first: Future[IdentityReply] = Future()
        self._identity: IdentityReply | None = None
        self._kept_alive = -KEEP_ALIVE_TIME
        self._sequence = 0
        self._last_error = ""
        self._late_until = 0.0  # steady [s]; 0: answers come in time
        self._taken: StateReply | None = None  # last state in this session
        self._latched = NO_FAULT  # faults of the link, until the board has accepted ARM
        self._counts = {"connections": 0, "garbled answers": 0, "repeated requests": 0, "frames refused by board": 0}
        self.reading = NO_LINK
        self.goal: int | None = None
        self.heartbeat = False
        self.injected: tuple[Injected, ...] = ()  # faults of the line to act, by the steady clock

    def start(self) -> IdentityReply:
        """Start the thread and return the identity. Raises what the first attempt raised; the thread has then ended."""
        self._stop.clear()
        self._ended.clear()
        self._first = Future()
        self._thread = threading.Thread(target=self._run, name="ceiling motor link", daemon=True)
        self._thread.start()
        try:
            return self._first.result()
        except MotorError:
            self.stop()
            self._reports.clear()  # the caller gets the error itself
            raise

    def stop(self) -> None:
        """End the thread; it disarms first if it can."""
        self._stop.set()
        if self._thread is not None:
            self._ended.wait()  # an interrupted join takes a running thread for an ended one: the motor would stay on
            self._thread.join()
        self._thread = None
        self.reading, self._latched = NO_LINK, NO_FAULT

    def keep_alive(self) -> None:
        """Note that the caller still runs: the heartbeat continues for KEEP_ALIVE_TIME."""
        self._kept_alive = time.monotonic()

    def submit(self, job: Job) -> None:
        """Queue a job. Raises `LinkError` without a link or with too many waiting."""
        if self.reading.mode is Mode.UNCONFIGURED:
            raise LinkError("no connection to the board; it is looked for")
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            raise LinkError(f"{QUEUE} commands are waiting for the board: it answers too slowly") from None

    def reports(self) -> list[str]:
        """Return the events since the last call, one line each."""
        return [self._reports.popleft() for _ in range(len(self._reports))]

    def health(self) -> dict[str, str]:
        """Return identity and counters for diagnostics."""
        board, name = self._identity, ""
        if board is not None:
            name = f"{self._settings.port}: {board.name} {board.version}, boot {board.boots} ({board.reset_cause})"
        return {"hardware_id": name, "last error": self._last_error} | {k: str(v) for k, v in self._counts.items()}

    # -- the thread ------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._keep_connected()
        finally:
            self._ended.set()

    def _keep_connected(self) -> None:
        wait = FIRST_WAIT
        while not self._stop.is_set():
            before = self._counts["connections"]
            try:
                self._connect_and_serve()
            except MotorError as error:
                self._failed(error)
            except Exception as error:  # an exception would end the thread without a report
                self._failed(LinkError(f"link to the board failed: {type(error).__name__}: {error}"))
            wait = FIRST_WAIT if self._counts["connections"] > before else min(2 * wait, LONGEST_WAIT)
            self._stop.wait(wait)

    def _failed(self, error: MotorError) -> None:
        self._lost(error)
        if not self._first.done():
            self._first.set_exception(error)

    def _connect_and_serve(self) -> None:
        with closing(SerialPort(self._settings.port, self._settings.baud)) as port:
            session = Session(FaultyPort(port, lambda: self.injected))
            while not self._stop.is_set():
                self._identify(session)
                try:
                    self._serve(session)
                except SessionLostError as error:
                    self._lost(error)

    def _identify(self, session: Session) -> None:
        identity = session.identify(self._settings.identify_timeout, self._stop.is_set)
        check_identity(identity, self._settings.limits)
        before, self._identity, self._taken = self._identity, identity, None
        self._counts["connections"] += 1
        if before is not None and before.boots != identity.boots and self.heartbeat:
            self._latched |= Fault.RESTARTED
        self._poll(session)
        if before is not None:
            restarted = "" if before.boots == identity.boots else f", restarted ({identity.reset_cause})"
            until = f" until ~/rearm: {in_words(self.reading.faults)}" if self.reading.faults else ""
            self._report(f"board found again at {self._settings.port}{restarted}; motor off{until}")
        if not self._first.done():
            self._first.set_result(identity)

    def _serve(self, session: Session) -> None:
        """Poll at the node's rate, jobs in between, until the link is lost or it is stopped."""
        due = time.monotonic()
        while not self._stop.is_set():
            due = max(due + 1.0 / self._settings.rate, time.monotonic())
            while (left := due - time.monotonic()) > 0:
                try:
                    self._carry_out(session, self._jobs.get(timeout=left))
                except queue.Empty:
                    break
            self._poll(session)
        session.request("DISARM")

    def _poll(self, session: Session) -> None:
        alive = self.heartbeat and time.monotonic() - self._kept_alive < KEEP_ALIVE_TIME
        begun = time.monotonic()
        reply = session.request("BEAT" if alive else "STATE")
        self._judge_delay(time.monotonic() - begun)
        if isinstance(reply, Refusal):
            raise SessionLostError(f"the board no longer follows: {reply}; it is identified again")
        self._take(reply)
        self._counts["garbled answers"], self._counts["repeated requests"] = session.garbled, session.repeated

    def _judge_delay(self, took: float) -> None:
        """Report answers that begin to come late, and that they come in time again."""
        now = time.monotonic()
        if took > LATE:
            if not self._late_until:
                self._report(f"the board answers late, after {took:.2f} s: the height reported is as old")
            self._late_until = now + AGAIN
        elif self._late_until and now > self._late_until:
            self._late_until = 0.0
            self._report(f"the board answers within {LATE:g} s again")

    def _check_plausible(self, reply: StateReply) -> None:
        """Raise `SessionLostError` for a height that this motor cannot have reached: the answer is not the board's."""
        before, self._taken = self._taken, reply
        if before is None or reply.faults or not (before.homed and reply.homed):
            return
        elapsed = max(0.0, reply.uptime - before.uptime)
        if abs(reply.height - before.height) > FASTER * self._settings.speed * elapsed + PLAY:
            raise SessionLostError(
                f"the board's answers go from {before.height:.4f} to {reply.height:.4f} m in {elapsed:.3f} s, which "
                "its motor cannot: it is identified again"
            )

    def _carry_out(self, session: Session, job: Job) -> None:
        waited = time.monotonic() - job.received
        try:
            if waited > self._settings.command_timeout:
                raise CommandStaleError(f"{job.commands[0][0]} ignored: it waited {waited:.2f} s; the ceiling stays")
            for word, arguments in job.commands:
                reply = session.request(word, *arguments)
                if isinstance(reply, Refusal):
                    self._poll(session)
                    faults = f" ({in_words(self.reading.faults)})" if self.reading.faults else ""
                    raise NotReadyError(f"the board refused {word}: {reply}{faults}")
                if word == "ARM":
                    self._latched = NO_FAULT
                self._take(reply)
        except MotorError as error:
            self.goal = None
            if not job.awaited:
                self._report(str(error))
            job.done.set_exception(error)
            if isinstance(error, LinkError):
                raise
        except Exception as error:
            job.done.set_exception(error)
            raise
        else:
            self._sequence = self._sequence if job.sequence is None else job.sequence
            self.reading = replace(self.reading, sequence=self._sequence)
            job.done.set_result(None)

    def _take(self, reply: object) -> None:
        if not isinstance(reply, StateReply):
            return
        self._check_plausible(reply)
        speed = self._settings.speed if reply.mode is Mode.MOVING else 0.0
        upward = reply.target > reply.height
        self._counts["frames refused by board"] = reply.rejected
        self.goal = self.goal if reply.mode in (Mode.MOVING, Mode.HOLDING) else None
        self.reading = Reading(
            mode=Mode.FAULT if self._latched else reply.mode,
            homed=reply.homed,
            faults=reply.faults | self._latched,
            height=reply.height,
            target=reply.target,
            velocity=speed if upward or not speed else -speed,
            speed=self._settings.speed,
            sequence=self._sequence,
            time=reply.uptime,
        )

    def _lost(self, error: MotorError) -> None:
        """Discard the state, latch the loss if the motor was armed, fail the jobs that wait, report the error once."""
        self._latched |= Fault.LINK_LOST if self.heartbeat else NO_FAULT
        self.reading, self.goal = replace(NO_LINK, faults=self._latched), None
        while not self._jobs.empty():
            self._jobs.get_nowait().done.set_exception(error)
        if str(error) != self._last_error:
            self._report(str(error))

    def _report(self, text: str) -> None:
        self._last_error = text
        self._reports.append(text)
