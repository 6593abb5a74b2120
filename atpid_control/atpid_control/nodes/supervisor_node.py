# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Supervises a run in real time: whether the nodes answer, and whether the quantities keep to their limits.

The motor moves and sends its heartbeat only while messages of `supervisor/state` permit it, and so does the exciter,
which a motor that goes off stops, too: the emergency stop opens the motor's contact.
"""

import sys
import time
from functools import partial

from atpid_interfaces.msg import CeilingState, Event, SampleBlock, SupervisorState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.errors import BAD_INPUT
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher, status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, STATES, STEADY
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.nodes.single_instance import started_twice
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import RunState
from atpid_control.nodes.supervisor_checks import LoopChecker, QuantityWatch
from atpid_control.nodes.supervisor_requests import EXCITER, MOTOR, DeviceRequests, MotorRequests, NodeQuestions
from atpid_control.supervision.limits import QUANTITIES, SUPERVISOR, AbortLevels, Levels, Passed, PassedLevel
from atpid_control.supervision.states import Change, NodeLiveness, Situation, Supervision

#: Between two turns [s]; a turn later than twice that was held up.
_TURN = 0.05
#: How long the last state and events may take to reach those who have subscribed, one of whom may hang [s].
_DELIVERY = 1.0
#: No drive is armed sooner after a stop: one that hangs for less has seen it, and one that hangs for longer is off [s].
STOP_LASTS = 0.35
_SENSORS = ("sensors/laser", "sensors/accelerometer")
_LEVELS = {
    RunState.READY: DiagnosticStatus.OK,
    RunState.STARTING: DiagnosticStatus.WARN,
    RunState.DEGRADED: DiagnosticStatus.WARN,
}


class SupervisorNode(Node):
    """Parameters, topics, services, and one call into the rules for each turn, block and state."""

    def __init__(self, **node_options: object) -> None:
        """Raise ParameterError or SupervisionError, in one line, for bad parameters. `done`: exit status."""
        super().__init__("supervisor_node", **node_options)
        self._values = declare(self, SUPERVISOR)
        nodes = [name for name in self._values["nodes"] if name]
        self._answers = NodeLiveness(nodes, self._values["answer_time"], 2.0 * _TURN)
        self._supervision = Supervision(self._answers, [name for name in self._values["needed"] if name])
        levels = {
            name: Levels(*(self._values[f"{name}_{kind}"] for kind in ("warning", "abort"))) for name in QUANTITIES
        }
        contact = self._values["contact_acceleration"], self._values["contact_dead_time"]
        self._quantities = QuantityWatch(AbortLevels(levels), contact, self._on_passed)
        self._situation: Situation | None = None
        self.done: Future = Future()
        self.error = ""
        self._make_topics()

    def _make_topics(self) -> None:
        self._events = EventPublisher(self)
        self._states = self.create_publisher(SupervisorState, "supervisor/state", STATES)
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)
        self._questions = NodeQuestions(self, self._answers)
        self._motor = MotorRequests(self)
        self._exciter = DeviceRequests(self, EXCITER) if EXCITER in self._answers.nodes else None
        self._stops, self._stopped_at = 0, 0.0  # requests and causes to stop so far; steady time of the last one [s]
        self._check = LoopChecker(self, self._answers.nodes, self._values["scene"], self._values["check_time"])
        for topic in _SENSORS:
            subscribe(self, SampleBlock, topic, self._on_block, BLOCKS)
        subscribe(self, CeilingState, "ceiling/state", self._on_state, STATES)
        waiting = ReentrantCallbackGroup()  # while these wait for the motor's answer, all else goes on
        self.create_service(Trigger, "~/stop", self._on_stop, callback_group=waiting)
        self.create_service(Trigger, "~/rearm", self._on_rearm, callback_group=waiting)
        self.create_service(Trigger, "~/check", self._on_check)
        self._own_timers = [
            self.create_timer(_TURN, self._turn, clock=STEADY),
            self.create_timer(1.0, self._check_alone, clock=STEADY),
        ]

    def _turn(self) -> None:
        now = time.monotonic()
        # one that is not needed may end in order, and the run with it
        for change in self._answers.check(now, self._questions.ended().intersection(self._values["needed"])):
            self._report(change)
        self._questions.ask(now)
        self._publish(now)
        limits = self._values["give_up"], self._values["restart_time"]
        lost = self._supervision.given_up(now, *limits, self._questions.runs_here)
        if lost:
            silence = self._answers.silence(lost, now)
            passed = max(limit for limit in limits if limit < silence)
            self._end(f"{lost} has not answered for {passed:g} s: the run ends", silence)
        self._check_loop(now)

    def _check_loop(self, now: float) -> None:
        before = self._check.decided
        found = self._check.turn(now)
        for line in found:
            self._events.publish(Event.ALARM, Event.ABORT, f"loop check: {line}")
        if found:
            self._stop(f"loop check: {'; '.join(found)}")
            self._end(f"loop check: {'; '.join(found)}", float(len(found)))
        elif self._check.decided and not before:
            self._events.publish(Event.INFO, Event.SUPERVISION, "loop check passed")

    def _end(self, text: str, value: float) -> None:
        """End the run, with a line that gives the reason."""
        if self.done.done():
            return
        self.error = text
        self._events.publish(Event.ALARM, Event.SUPERVISION, text, value)
        print(f"error: {text}", file=sys.stderr, flush=True)
        self.done.set_result(BAD_INPUT)

    def _report(self, change: Change) -> None:
        if change.back:
            text = f"{change.name} answers again"
            self._events.publish(Event.INFO, Event.RESUMED, text, change.silence)
            return
        why = self._questions.in_words(change.name)
        needed = change.name in self._values["needed"]
        held = "the ceiling is held, without heartbeats" if needed else "motion stays permitted"
        severity = Event.ALARM if needed else Event.WARNING
        text = f"{change.name} {why} for {change.silence:.2f} s: {held}"
        self._events.publish(severity, Event.STALE, text, change.silence)

    def _publish(self, now: float) -> None:
        """Publish the state; an event and diagnostics at once where it has changed."""
        situation = self._supervision.situation()
        message = SupervisorState(state=int(situation.state), permit=situation.permit, stop=situation.stop)
        message.header.stamp = self.get_clock().now().to_msg()
        message.reason, message.nodes = situation.reason, list(self._answers.nodes)
        message.silence = [self._answers.silence(name, now) for name in self._answers.nodes]
        self._states.publish(message)
        before, self._situation = self._situation, situation
        if before is None or before.state != situation.state:
            text = f"{situation.state.name.lower()}{': ' if situation.reason else ''}{situation.reason}"
            expected = situation.permit or situation.state in (RunState.STARTING, RunState.SHUTDOWN)
            severity = Event.INFO if expected else Event.ALARM
            self._events.publish(severity, Event.SUPERVISION, text)
            self._diagnostics.publish()

    def _on_block(self, block: SampleBlock) -> None:
        if not block.handshake:
            self._check.on_block(block, time.monotonic())
            self._quantities.on_block(block, time.monotonic())

    def _on_state(self, state: CeilingState) -> None:
        if not state.handshake:
            off = self._motor.on_state(state, time.monotonic())
            if off and self._exciter:
                self._stop(off)
            self._quantities.on_motor(state.mode in (CeilingState.HOMING, CeilingState.MOVING), time.monotonic())

    def _on_passed(self, passed: Passed) -> None:
        if passed.severity is PassedLevel.WARNING:
            self._events.publish(Event.WARNING, Event.LIMIT, str(passed), passed.value)
            return
        self._stop(str(passed))
        self._events.publish(Event.ALARM, Event.ABORT, f"{passed}: motor off", passed.value)

    def _stop(self, reason: str) -> None:
        self._stops, self._stopped_at = self._stops + 1, time.monotonic()
        if self._supervision.stop(reason):
            self._publish(time.monotonic())  # now: the motor need not wait for the next turn

    async def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop on request of the operator: all off until `~/rearm`. Success: the devices have confirmed it."""
        self._stop("stopped by the operator")
        motor = await self._motor.stop()
        exciter = await self._exciter.stop() if self._exciter else ""
        off = "motor and exciter off" if self._exciter else "motor off"
        response.success, response.message = True, f"{off}, confirmed; supervisor_node/rearm arms it again"
        if problem := motor or exciter:
            what = "motor" if motor else "exciter"
            text = f"permission withdrawn; {what} off not confirmed ({problem}): use the emergency stop"
            response.success, response.message = False, text
        return response

    async def _on_rearm(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Clear a stop or an abort whose cause is gone, and arm the motor alone; only on request of a person.

        Where the motor does not confirm that it is armed, the run is stopped: nothing may arm or move it later.
        """
        stops = self._stops
        await self._motor.pause(self._stopped_at + STOP_LASTS - time.monotonic())
        answers = await self._motor.answers()  # one that hangs must not find the request when it goes on
        text = self._rearm_refusal(answers, stops)
        response.success = not text
        if not text:
            self._quantities.limits.rearm()
            self._publish(time.monotonic())
            response.success, text = await self._motor.arm()
            text += f"; {EXCITER}/rearm arms the exciter" if response.success and self._exciter else ""
            if self._stops > stops:
                response.success, text = False, f"stopped meanwhile: {self._supervision.stopped}"
            elif not response.success:
                self._stop(f"not armed: {text}")
        response.message = f"armed; {text}" if response.success else f"not armed: {text}"
        return response

    def _rearm_refusal(self, motor: bool, stops: int) -> str:
        """Return why nothing is armed, one line; empty: the stop is cleared. motor: whether its node answers."""
        if self._stops > stops:
            return f"stopped meanwhile: {self._supervision.stopped}"
        if not motor:
            return f"{MOTOR} {self._questions.in_words(MOTOR)}: end the run and start it again"
        if above := self._quantities.still_above():
            return f"{', '.join(above)}: still above the abort level"
        return self._supervision.rearm()

    def _on_check(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Make the loop check now; nothing is moved or stopped."""
        found = self._check.failures(time.monotonic())
        response.success, response.message = not found, "\n".join(found) or "loop check passed"
        return response

    def _statuses(self) -> list[DiagnosticStatus]:
        now, situation = time.monotonic(), self._situation or self._supervision.situation()
        silence = {f"{name} [s]": f"{self._answers.silence(name, now):.2f}" for name in self._answers.nodes}
        values: dict[str, object] = {"motion permitted": situation.permit, "stopped": situation.stop}
        values |= silence | self._quantities.values()
        level = _LEVELS.get(situation.state, DiagnosticStatus.ERROR)
        return [status(self, "supervision", level, situation.reason or situation.state.name.lower(), values)]

    def _check_alone(self) -> None:
        if started_twice(self) and not self.done.done():
            self.done.set_result(BAD_INPUT)

    def close(self) -> None:
        """Withdraw the permission; stop the timers."""
        self._supervision.end()
        if self.context.ok():
            self._publish(time.monotonic())
            # why a run ends and that the motor is off must not be lost with this process
            for publisher in (self._events.publisher, self._states):
                publisher.wait_for_all_acked(Duration(seconds=_DELIVERY))
        self._diagnostics.cancel()
        for timer in self._own_timers:
            timer.cancel()


main = partial(run_node, SupervisorNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
