# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whatever is done to the exciter in whatever order: no output after a stop until it is armed and commanded anew.

The nodes are the real ones over real DDS, with LabJack's own package on the stand-in T7, whose every sample is looked
at. What is allowed is said by an account of the test's own (`exciter_graph.Account`). Order and logic are judged, and
times only where they are far over, by how late the test itself was.
"""

import itertools
import math
import os
import random
import signal
import time
from collections.abc import Callable
from contextlib import closing, suppress
from functools import wraps
from pathlib import Path
from typing import Any

import pytest
from atpid_interfaces.msg import (
    CeilingState,
    Excitation,
    ExcitationCommand,
    ExcitationState,
    SampleBlock,
    SupervisorState,
)  # fmt: skip
from excitation_rigs import output_process, stand_in
from exciter_graph import (
    ABORT,
    BAND,
    EXCITER,
    HIGHEST,
    HUNG,
    IDENTIFIER,
    MOTOR,
    STOPPED,
    SUPERVISOR,
    TOLERANCE,
    UNREACHABLE,
    Account,
    Ban,
    Decision,
    Estimate,
    Graph,
    Hang,
    Stretch,
    refused,
)
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule, run_state_machine_as_test
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, STATES
from atpid_common.testing import wait_for
from atpid_control.nodes.live_node import OperatorRequests
from atpid_control.views.live.requests import Plain
from atpid_driver.standins import build

LONG = settings.get_current_profile_name() in ("long", "fresh")
#: Interleavings in rounds, since hypothesis makes of one that it has drawn some that are nearly the same.
ROUNDS = 100 if LONG else 1
ROUND = settings(
    max_examples=10 if LONG else 3, stateful_step_count=12, deadline=None, phases=[Phase.generate], database=None,
    suppress_health_check=list(HealthCheck), report_multiple_bugs=False,
)  # fmt: skip
#: How often an example is begun anew where this machine is so busy that a stop comes before its output, how long that
#: is waited for, and for how long examples are begun [s]: what a busy machine does not get to is left out.
TRIES, SOON, BEGUN_FOR = 3, 3.0, math.inf if LONG else 45.0
#: Until an output is held, on a machine without other work [s].
HELD = 1.9
#: Between two commands of the commander [s].
PERIOD = 0.05
ARMED = (CeilingState.HOMING, CeilingState.HOLDING, CeilingState.MOVING)
OFF, SINE, SWEEP, RANDOM = (getattr(ExcitationCommand, name) for name in ("OFF", "SINE", "SWEEP", "RANDOM"))
TOPIC = "excitation/command"


class Stand:
    """The graph, the person and the program that command it, and the account of what they do."""

    def __init__(self, folder: Path, library: Path) -> None:
        self.graph = Graph(folder, library)
        self.record, self.identifier = self.graph.record, self.graph.identifier
        self.account = Account(self.record, self.graph.unresponsive)
        self.log: list[str] = []
        self.operator = self.graph.add("operator")
        self.page = OperatorRequests(self.operator, EventPublisher(self.operator))
        names = [f"{node}/{what}" for node in (EXCITER, SUPERVISOR) for what in ("stop", "rearm")] + [f"{MOTOR}/stop"]
        self.services = {name: self.operator.create_client(Trigger, name) for name in names}
        self.lifecycle = self.operator.create_client(ChangeState, f"{EXCITER}/change_state")
        self.blocks = self.operator.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
        self.commands = self.operator.create_publisher(ExcitationCommand, TOPIC, 10)
        self.repeats, self.due = False, 0.0
        self.second: tuple[Node, Any, ExcitationCommand | None] | None = None
        self.second_since, self.second_sent = 0.0, [0.0]
        self.sequence, self.waiting = itertools.count(1), 0
        self.supervisor, self.ceiling, self.state = SupervisorState(), CeilingState(), ExcitationState()
        self.unpermitted: list[float] = []  # stamps of the states in a row that permit nothing, steady [s]
        self.supervised = math.nan  # the stamp of the last one
        self.disarmed = math.nan  # when somebody switched the motor off, steady [s]
        self.rests = math.nan  # since when the exciter has said that there is no output, steady [s]
        self.problem = self.told = ""
        self.end = time.monotonic() + BEGUN_FOR
        self.runs = self.holds = 0  # how often there was an output, and how many states said that it is held
        watch = self.operator.create_subscription
        watch(SupervisorState, "supervisor/state", self._on_supervisor, STATES)
        watch(CeilingState, "ceiling/state", self._on_ceiling, STATES)
        watch(ExcitationState, "excitation/state", self._on_state, STATES)

    # What the nodes say.

    def note(self, text: str) -> None:
        self.log.append(f"{time.monotonic():.3f} {text}")

    def fail(self, problem: str) -> None:
        self.problem = self.problem or problem
        self.note(f"BROKEN: {problem}")

    def _on_supervisor(self, state: SupervisorState) -> None:
        at = steady(state)
        if (state.state, state.stop) != (self.supervisor.state, self.supervisor.stop):
            self.note(f"supervisor: {state.state} {state.reason}")
        if state.stop and not self.supervisor.stop:
            self.account.ban("the supervisor's stop", at, STOPPED)
        if self.supervisor.permit and not state.permit and not state.stop:
            if self.account.commanded(at - 0.1, at):
                self.account.ban("the permission was withdrawn", at, STOPPED)
            self.account.ban("nothing is permitted", at, STOPPED, latched=False)
        if state.permit and not self.supervisor.permit:
            for ban in self.account.bans:
                if ban.why == "nothing is permitted":
                    ban.until = min(ban.until, at)
        self.unpermitted = [] if state.permit else [*self.unpermitted, at]
        self.supervisor, self.supervised = state, at

    def _on_ceiling(self, state: CeilingState) -> None:
        if self.ceiling.mode in ARMED and state.mode not in ARMED:
            self.note(f"motor: {state.mode} {state.fault}")
            self.account.ban("the motor went off", steady(state), STOPPED, SUPERVISOR)
        self.ceiling = state

    def _on_state(self, state: ExcitationState) -> None:
        at, before = steady(state), self.state
        if (state.mode, state.fault, state.held) != (before.mode, before.fault, before.held):
            held = " held" if state.held else ""
            self.note(f"exciter: {state.mode}{held} {state.fault}")
        if state.held:
            self.holds += 1
            self._check_held(at)
        off = state.mode in (ExcitationState.OFF, ExcitationState.FAULT) and "not confirmed" not in state.fault
        if not off or state.amplitude != 0.0:
            self.rests = math.nan
        elif math.isnan(self.rests) or at - steady(before) > 0.12:  # what is between two states has not been said
            self.rests = at
        late = 3.0 * self.record.late(at - 0.5, at)
        rested = not math.isnan(self.rests)
        if rested and not math.isnan(out := self.record.first(self.rests + 0.2 + late, at - 0.15 - late)):
            self.fail(f"output at {out:.3f} s, while the exciter says since {self.rests:.3f} s that there is none")
        self.state = state

    def _check_held(self, at: float) -> None:
        """Compare with what was published last; what is on its way at the time is not."""
        late = 3.0 * self.record.late(at - 0.7, at) + sum(
            min(end, at) - begin for begin, end in self.graph.unresponsive([EXCITER]) if begin < at and end > at - 0.7
        )
        known = [one for one in list(self.identifier.sent) if one.at < at]
        arriving = [one for one in known if one.at > at - 0.15 - late]
        decided = [one for one in self.account.decisions if one.first < at and not one.refused]
        arrived = [one for one in decided if one.first < at - 0.3 - late]
        wanted = decided[max(0, len(arrived) - 1) :]
        candidates = known[len(known) - len(arriving) - 1 :]
        if not any(holds(one, each.message, at - 0.6 - late) for one in candidates for each in wanted):
            last = [(*tuple(one)[2:5], round(at - one.of, 3)) for one in candidates]
            self.fail(f"held at {at:.3f} s, of which the last estimates say {last}")

    # What persons and programs do.

    def spin(self, seconds: float) -> None:
        """Go on for so long, the commander with its commands [s]."""
        end = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            self.turn(min(0.01, max(0.0, end - now)))
            if now >= end:
                return

    def turn(self, timeout: float = 0.01) -> None:
        if (now := time.monotonic()) >= self.due:
            self.due = now + PERIOD
            if self.repeats:
                self.send()
            if self.second is not None and self.second[2] is not None:
                self.second_sent.append(time.monotonic())
                self.second[1].publish(self.second[2])
        self.graph.executor.spin_once(timeout_sec=timeout)
        self.graph.raise_errors()

    def send(self) -> None:
        decision = self.account.decision
        assert decision is not None
        decision.message.header.stamp = self.operator.get_clock().now().to_msg()
        decision.sent.append(time.monotonic())
        self.commands.publish(decision.message)

    def decide(self, **values: Any) -> None:
        self._decided(ExcitationCommand(sequence=next(self.sequence), **values))

    def _decided(self, command: ExcitationCommand) -> None:
        now, before = time.monotonic(), self.account.decision
        if command.kind == RANDOM:
            self.record.noise = True
        elif not self.record.any(now - 0.5, now) and (before is None or before.message.kind != RANDOM):
            self.record.noise = False
        decision = Decision(command, now, refused(command))
        self.account.decisions.append(decision)
        if command.kind == OFF:
            self.account.ban("OFF", now, STOPPED, latched=False)
        outside = " (outside the limits)" if decision.refused else ""
        self.note(f"command {command.sequence}: kind {command.kind}, {command.amplitude:g} m, {command.frequency:g} to "
                  f"{command.end_frequency:g} Hz, hold {command.hold}{outside}")  # fmt: skip
        self.repeats, self.due = True, now + PERIOD
        self.rests = math.nan  # an output that a stop ends at once may lie between two states
        self.send()

    def restart_commander(self) -> None:
        """Let the program that commands end and begin again: its first command is a new decision."""
        decision = self.account.decision
        self.operator.destroy_publisher(self.commands)
        self.commands = self.operator.create_publisher(ExcitationCommand, TOPIC, 10)
        wait_for(self.commands.get_subscription_count, turn=self.graph.executor.wake)
        self.note("the commander starts again")
        if decision is not None:
            self._decided(copied(decision.message))

    def second_comes(self, speaks: bool) -> None:
        node = self.graph.add("second")
        publisher = node.create_publisher(ExcitationCommand, TOPIC, 10)
        wait_for(publisher.get_subscription_count, turn=self.graph.executor.wake)
        command = ExcitationCommand(kind=SINE, amplitude=0.5 * HIGHEST, frequency=9.0, sequence=7) if speaks else None
        self.second, self.second_since = (node, publisher, command), time.monotonic()
        self.account.others.append(Stretch(self.second_since, math.inf))
        self.note(f"a second commander, {'speaks' if speaks else 'silent'}")

    def second_leaves(self) -> None:
        """Let it leave; what was commanded before it came is void where a command has come meanwhile."""
        assert self.second is not None
        node, publisher, _ = self.second
        self._judge_second(time.monotonic())
        node.destroy_publisher(publisher)
        self.graph.remove(node)
        self.second = None
        now = time.monotonic()
        self.account.others[-1] = Stretch(self.second_since, now)
        for ban in self.account.bans:
            if ban.why == "two commanders":
                ban.until = min(ban.until, now)
        self.note("the second commander leaves")

    def _judge_second(self, now: float) -> None:
        """Add what follows once a command has come beside it."""
        if self.second is None or any(ban.since == self.second_since for ban in self.account.bans):
            return
        sent = [at for one in self.account.decisions for at in one.sent] + self.second_sent
        first = min((at for at in sent if at > self.second_since + 0.02), default=math.inf)
        busy = any(one.begin < now and one.end > first for one in self.graph.unresponsive([EXCITER]))
        if now - first - 3.0 * self.record.late(first, now) > 0.3 and not busy:
            for why, latched in (("two commanders", False), ("a second commander came", False)):
                self.account.ban(why, self.second_since, first - self.second_since + STOPPED, latched=latched)
            self.account.bans[-2].since = first

    def _judge_disarmed(self, now: float) -> None:
        """Add what follows from a motor that has been switched off for a while."""
        if now - self.disarmed - 3.0 * self.record.late(self.disarmed, now) > 0.2:
            self.account.ban("motor switched off", self.disarmed, STOPPED + 0.1, MOTOR, SUPERVISOR)
            self.disarmed = math.nan

    def ask(self, name: str, answered: Callable[[bool, str, float], None]) -> Callable[[], bool]:
        """Call a service, or do as the page does; return whether it has been answered."""
        now, done = time.monotonic(), []

        def finished(success: bool, text: str) -> None:
            done.append(True)
            self.waiting -= 1
            self.note(f"answer to {name}: {success} {text}")
            answered(success, text, now)

        def of(future: Future) -> None:
            finished(bool(future.result().success), str(getattr(future.result(), "message", "")))

        self.note(f"ask {name}")
        self.waiting += 1
        if name in self.services:
            self.services[name].call_async(Trigger.Request()).add_done_callback(of)
        elif name in ("activate", "deactivate"):
            number = getattr(Transition, f"TRANSITION_{name.upper()}")
            self.lifecycle.call_async(ChangeState.Request(transition=Transition(id=number))).add_done_callback(of)
        else:
            self.page.do(Plain(number=1, do=name), lambda answer: finished(*answer))  # type: ignore[arg-type]
        return lambda: bool(done)

    def stop(self, how: str) -> Callable[[], bool]:
        """Stop in one way; return whether it has been answered."""
        now, account = time.monotonic(), self.account
        if how == "abort":
            self.displacement(2.0 * ABORT)
            self.note("abort level")
            account.ban("an abort level", now, STOPPED, SUPERVISOR)
            return lambda: True
        ban: Ban | None = None
        if how == f"{SUPERVISOR}/stop":
            ban = account.ban(how, now, STOPPED, SUPERVISOR)
        elif how in ("disarm", f"{MOTOR}/stop"):  # what is armed again before it has said so has not been off
            self.disarmed = now if self.ceiling.mode in ARMED and not self.waiting else math.nan
        else:
            ban = account.ban(how, now, STOPPED)

        def answered(success: bool, text: str, _asked: float) -> None:
            exciter = how == "stop" and "exciter off, confirmed" in text
            if ban is not None and (exciter or (success and how in (f"{SUPERVISOR}/stop", f"{EXCITER}/stop"))):
                ban.confirmed = time.monotonic()
            if how == "deactivate" and ban is not None:
                if success:
                    ban.confirmed = time.monotonic()
                else:  # it was inactive: nothing has been stopped
                    account.bans.remove(ban)

        return self.ask(how, answered)

    def arm_exciter(self, how: str) -> Callable[[], bool]:
        """Arm the exciter in one way; return whether it has been answered."""
        arm = self.account.arm(time.monotonic())

        def answered(success: bool, text: str, asked: float) -> None:
            arm.refused = not success or "already" in text
            late = 0.15 + 3.0 * self.record.late(asked - 0.3, time.monotonic())
            inside = [at for at in self.unpermitted if asked - late < at]
            refusing = bool(inside) and inside[0] < asked - late + 0.1 and self.supervised > time.monotonic() - 0.15
            if success and refusing and self.unpermitted[0] < asked - late:
                self.fail(f"{how} succeeded, while nothing was permitted since {self.unpermitted[0]:.3f} s")

        return self.ask(how, answered)

    def arm_all(self, how: str) -> Callable[[], bool]:
        """Clear the supervisor's stop, which leaves the exciter as it is."""
        self.displacement(0.0)
        self._judge_disarmed(time.monotonic())
        self.disarmed = math.nan
        return self.ask(how, lambda *_: None)

    def displacement(self, value: float) -> None:
        """Publish a block in which the beam is so far away [m]."""
        self.blocks.publish(SampleBlock(rate=1000.0, channels=["beam_displacement"], units=["m"], skew=[0.0],
                                        data=[value] * 5))  # fmt: skip

    def hang(self, name: str, seconds: float) -> None:
        self.account.hangs.append(Hang(name, time.monotonic()))
        self.graph.spinners[name].hang(seconds)
        self.note(f"{name} hangs for {seconds:g} s")

    def end_process(self, how: signal.Signals) -> None:
        if not (number := output_process(self.graph.folder)):
            return
        now = time.monotonic()
        self.record.undisturbed = False
        with suppress(ProcessLookupError):
            os.kill(number, how)
        self.note(f"process of the output: {how.name}")
        self.account.disturbed.append(Stretch(now, now + 0.8))
        self.account.ban(f"the process of the output got {how.name}", now, HUNG)

    def device(self, how: str) -> None:
        """Unplug the device, or plug it in; a glitch is both."""
        now = time.monotonic()
        self.note(f"device: {how}")
        if how == "replug":
            self.graph.control.replug()
            return
        self.record.undisturbed = False
        self.graph.control.unplug()
        if how == "unplug":
            self.account.disturbed.append(Stretch(now, now + UNREACHABLE - STOPPED))
        else:
            self.graph.control.replug()
            self.account.disturbed.append(Stretch(now, now + 0.5))
        self.account.ban(f"device: {how}", now, HUNG)

    # What the test itself does.

    def judge(self) -> None:
        """Raise AssertionError with all that happened where something was broken."""
        now = time.monotonic()
        self._judge_second(now)
        self._judge_disarmed(now)
        self.account.follow(now, list(self.identifier.sent))
        self.graph.raise_errors()
        problem = self.problem or "; ".join(self.record.broken[:3]) or self.account.broken(now)
        if problem:
            raise AssertionError("\n".join([problem, *self.log]))

    def begin(self) -> None:
        """Bring all to a defined state: armed, at rest, nothing commanded, everything healthy."""
        graph = self.graph
        self.repeats = False
        if self.second is not None:
            self.second_leaves()
        graph.control.replug()
        self.identifier.honest()
        wait_for(lambda: not any(one.hanging for one in graph.spinners.values()), turn=self.turn)
        wait_for(lambda: not self.waiting, turn=self.turn)
        self._answered(f"{EXCITER}/stop")
        while not (self._answered(f"{EXCITER}/rearm") and self.told == "armed already" and self._permitted):
            if not self._permitted:  # also while the exciter has opened its device, in which it does not answer
                self.displacement(0.0)
                self._answered(f"{SUPERVISOR}/rearm")
            self.spin(0.1)
        wait_for(lambda: not self.record.any(time.monotonic() - 0.1, time.monotonic()), turn=self.turn)
        wait_for(lambda: self.state.mode == ExcitationState.OFF, turn=self.turn)
        self.record.forget()
        self.record.noise = False
        for spinner in graph.spinners.values():
            spinner.hangs.clear()
            spinner.busy.clear()
        self.account = Account(self.record, graph.unresponsive)
        self.account.ban("nothing was commanded", time.monotonic(), 0.0, latched=False)
        self.log.clear()
        self.problem, self.rests = "", math.nan
        self.unpermitted = []
        self.disarmed = math.nan

    @property
    def _permitted(self) -> bool:
        return bool(self.supervisor.permit and self.ceiling.mode in ARMED)

    def _answered(self, name: str) -> bool:
        found: list[bool] = []

        def answered(success: bool, text: str, _asked: float) -> None:
            self.told = text
            found.append(success)

        self.ask(name, answered)
        wait_for(lambda: found, turn=self.turn)
        return found[0]

    def close(self) -> None:
        self.graph.close()


def steady(message: Any) -> float:
    """Return the time of a stamp, steady [s]."""
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9 - time.time() + time.monotonic())


def copied(command: ExcitationCommand) -> ExcitationCommand:
    """Return a command that says the same."""
    fields: dict[str, str] = ExcitationCommand.get_fields_and_field_types()  # type: ignore[attr-defined]
    return ExcitationCommand(**{name: getattr(command, name) for name in fields})


def holds(estimate: Estimate, command: ExcitationCommand, since: float) -> bool:
    """Return whether an estimate shows that a command is held."""
    if estimate.quality != Excitation.STEADY or estimate.of < since or not command.hold:
        return False
    near = abs(math.log(estimate.amplitude / command.amplitude)) <= TOLERANCE * 1.05
    ends = [command.frequency] if command.kind == SINE else [command.frequency, command.end_frequency]
    low, high = min(ends) * (1.0 - 1.05 * TOLERANCE), max(ends) * (1.0 + 1.05 * TOLERANCE)
    return near and low <= estimate.frequency <= high


#: Times for which something lasts [s].
SHORT = st.sampled_from([0.0, 0.03, 0.1, 0.3, 0.6])
SECONDS = st.sampled_from([0.1, 0.25, 0.4, 0.7, 1.0])
AMPLITUDES = st.sampled_from([0.1, 0.5, 0.9, 1.0, 1.5]).map(lambda share: share * HIGHEST)
FREQUENCIES = st.sampled_from([BAND[0], 6.0, 10.0, 12.5, 17.0, BAND[1], 0.5 * BAND[0], 1.5 * BAND[1]])
STOPS = (f"{EXCITER}/stop", f"{SUPERVISOR}/stop", f"{MOTOR}/stop", "stop", "disarm", "abort", "deactivate")
ARMS = (f"{EXCITER}/rearm", "arm_exciter", "activate")


def act(**drawn: st.SearchStrategy[Any]) -> Callable[[Callable[..., None]], Any]:
    """Return a rule after which some time passes; it does nothing in an example that is left out."""

    def made(method: Callable[..., None]) -> Any:
        @wraps(method)
        def guarded(self: "Interleaving", then: float, **values: Any) -> None:
            if not self.left_out:
                method(self, **values)
                self.then(then)

        return rule(**{"then": SHORT, **drawn})(guarded)  # type: ignore[call-overload]

    return made


class Interleaving(RuleBasedStateMachine):
    """Acts in any order on the stand of the module."""

    stand: Stand
    left_out = False

    @initialize(hold=st.booleans(), held=st.booleans(), amplitude=AMPLITUDES)
    def run(self, hold: bool, held: bool, amplitude: float) -> None:
        """Begin with an output; where this machine does not come to it, the example is left out."""
        stand = self.stand
        self.left_out = time.monotonic() > stand.end
        for _ in range(0 if self.left_out else TRIES):
            stand.begin()
            stand.decide(kind=SINE, amplitude=min(amplitude, HIGHEST), frequency=12.5, hold=hold)
            begin = time.monotonic()
            while not stand.account.stopped() and time.monotonic() < begin + SOON:
                stand.turn()
                if stand.record.any(begin, time.monotonic()):
                    stand.runs += 1
                    self.then(HELD if hold and held else 0.3)
                    return
            busy = stand.record.late(begin - 0.5, time.monotonic()) > 0.05
            assert busy or stand.account.stopped(), "\n".join(["armed and commanded, and no output", *stand.log])
        self.left_out = True
        stand.note("left out")

    def then(self, seconds: float) -> None:
        self.stand.spin(seconds)
        self.stand.judge()

    def wait(self, answered: Callable[[], bool], waits: bool = True) -> None:
        """Wait for an answer, though not for one of a node that hangs."""
        end = time.monotonic() + 1.5
        while waits and not answered() and time.monotonic() < end:
            self.stand.turn()

    @act(amplitude=AMPLITUDES, frequency=FREQUENCIES, hold=st.booleans())
    def a_tone(self, **values: Any) -> None:
        self.stand.decide(kind=SINE, **values)

    @act(amplitude=AMPLITUDES, frequency=FREQUENCIES, end_frequency=FREQUENCIES, hold=st.booleans())
    def a_sweep(self, **values: Any) -> None:
        self.stand.decide(kind=SWEEP, duration=0.7, **values)

    @act(amplitude=st.sampled_from([0.05, 0.15, 0.5]).map(lambda share: share * HIGHEST),
         hold=st.sampled_from([False, False, True]))  # fmt: skip
    def noise(self, **values: Any) -> None:
        self.stand.decide(kind=RANDOM, frequency=5.0, end_frequency=15.0, **values)

    @act()
    def off(self) -> None:
        self.stand.decide(kind=OFF)

    @act(repeats=st.booleans())
    def repeat_it_or_be_silent(self, repeats: bool) -> None:
        self.stand.repeats = repeats
        self.stand.note("goes on commanding" if repeats else "is silent")

    @act(seconds=SECONDS)
    def it_pauses_and_goes_on(self, seconds: float) -> None:
        self.stand.repeats = False
        self.stand.note(f"is silent for {seconds:g} s")
        self.then(seconds)
        self.stand.repeats = self.stand.account.decision is not None

    @act()
    def the_commander_starts_again(self) -> None:
        self.stand.restart_commander()

    @act(speaks=st.booleans())
    def a_second_commander_comes_or_leaves(self, speaks: bool) -> None:
        if self.stand.second is None:
            self.stand.second_comes(speaks)
        else:
            self.stand.second_leaves()

    @act(speaks=st.booleans(), seconds=SECONDS)
    def a_second_commander_is_there_for_a_while(self, speaks: bool, seconds: float) -> None:
        if self.stand.second is None:
            self.stand.second_comes(speaks)
        self.then(seconds)
        self.stand.second_leaves()

    @act(how=st.sampled_from(STOPS), waits=st.booleans())
    def stop(self, how: str, waits: bool) -> None:
        self.wait(self.stand.stop(how), waits)

    @act(how=st.sampled_from([f"{SUPERVISOR}/rearm", "arm"]), waits=st.booleans())
    def arm(self, how: str, waits: bool) -> None:
        self.wait(self.stand.arm_all(how), waits)

    @act(how=st.sampled_from(ARMS), waits=st.booleans())
    def arm_exciter(self, how: str, waits: bool) -> None:
        self.wait(self.stand.arm_exciter(how), waits)

    @act(amplitude=AMPLITUDES, hold=st.booleans(), anew=st.booleans())
    def a_person_arms_all_and_commands(self, amplitude: float, hold: bool, anew: bool) -> None:
        """As it should be done; without a new command nothing may happen."""
        stand = self.stand
        stand.graph.control.replug()
        self.wait(stand.arm_all("arm"))
        self.wait(stand.arm_exciter("arm_exciter"))
        if anew:
            stand.decide(kind=SINE, amplitude=min(amplitude, HIGHEST), frequency=10.0, hold=hold)
        else:
            stand.repeats = True
        self.then(0.2)

    @act(name=st.sampled_from([EXCITER, SUPERVISOR, MOTOR, IDENTIFIER]), seconds=SECONDS)
    def a_node_hangs(self, name: str, seconds: float) -> None:
        self.stand.hang(name, seconds)

    @act(how=st.sampled_from([signal.SIGSTOP, signal.SIGKILL]))
    def the_process_of_the_output_ends(self, how: signal.Signals) -> None:
        self.stand.end_process(how)

    @act(how=st.sampled_from(["unplug", "replug", "glitch"]))
    def the_device(self, how: str) -> None:
        self.stand.device(how)

    @act(
        quality=st.sampled_from([Excitation.STEADY, Excitation.STEADY, Excitation.TRANSIENT, Excitation.POOR,
                                 Excitation.NONE]),
        gain=st.sampled_from([1.0, 1.0, 0.3, 0.9, 1.015, 1.03, 2.0]), pitch=st.sampled_from([1.0, 1.0, 0.5, 0.97, 1.5]),
        way=st.sampled_from(["fresh", "fresh", "frozen", "late", "none"]),
    )  # fmt: skip
    def it_is_identified(self, quality: int, gain: float, pitch: float, way: str) -> None:
        identifier = self.stand.identifier
        identifier.quality, identifier.gain, identifier.pitch, identifier.way = quality, gain, pitch, way
        self.stand.note(f"identified: quality {quality}, {gain:g} of the amplitude, {pitch:g} of the frequency, {way}")

    @act(then=st.sampled_from([0.5, 1.0, 2.0]))
    def time_passes(self) -> None:
        pass

    def teardown(self) -> None:
        """Nothing starts by itself, and nothing goes on once it is due to be off."""
        stand = self.stand
        if self.left_out or stand.problem or stand.record.broken:
            return
        end, spinners = time.monotonic() + 0.25, stand.graph.spinners.values()
        while time.monotonic() < end or stand.waiting or any(one.hanging for one in spinners) or (
            stand.account.pending(time.monotonic()) and stand.record.any(time.monotonic() - 0.1, time.monotonic())
        ):  # fmt: skip
            stand.turn()
        stand.judge()


def seeds() -> list[int]:
    """Return what each round is drawn by: the same each time; in CI and in the long run others, which are printed."""
    fresh = LONG or bool(os.environ.get("CI"))
    return [random.SystemRandom().getrandbits(32) for _ in range(ROUNDS)] if fresh else list(range(ROUNDS))


def test_no_interleaving_breaks_a_rule(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(tmp_path, monkeypatch)
    with closing(Stand(tmp_path, build())) as stand:
        wait_for(lambda: stand.state.mode == ExcitationState.OFF and stand.supervisor.permit, turn=stand.turn)

        class OfThisStand(Interleaving):
            def __init__(self) -> None:
                self.stand = stand
                super().__init__()

        for number in seeds():
            print(f"seed {number}")
            run_state_machine_as_test(seed(number)(OfThisStand), settings=ROUND)
        print(f"{stand.runs} interleavings, {stand.record.samples} samples, {stand.holds} states that it is held")
        assert stand.runs
