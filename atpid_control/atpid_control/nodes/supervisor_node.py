# SPDX-License-Identifier: Apache-2.0
"""Supervises a run in real time: whether the nodes answer, and whether the quantities keep to their limits.

The motor moves and sends its heartbeat only while messages of `supervisor/state` permit it.
"""

import sys
import time
from functools import partial
from typing import Any

from atpid_interfaces.msg import CeilingState, Event, SampleBlock, SupervisorState
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.errors import BAD_INPUT
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher, status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, STATES
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.nodes.single_instance import started_twice
from atpid_common.real_time import LOOP_PRIORITY
from atpid_control.nodes.loop_checker import LoopChecker
from atpid_control.nodes.node_questions import NodeQuestions
from atpid_control.nodes.parameter_tables import SUPERVISOR
from atpid_control.nodes.quantity_watch import QuantityWatch
from atpid_control.supervision.answers import Answers, Change
from atpid_control.supervision.limits import QUANTITIES, Levels, Limits, Passed, Severity
from atpid_control.supervision.states import Situation, State, Supervision

#: Between two turns [s]; a turn later than twice that was held up.
TURN = 0.05
SENSORS = ("sensors/laser", "sensors/accelerometer")
LEVELS = {
    State.READY: DiagnosticStatus.OK,
    State.STARTING: DiagnosticStatus.WARN,
    State.DEGRADED: DiagnosticStatus.WARN,
}


class SupervisorNode(Node):
    """Parameters, topics, services, and one call into the rules for each turn, block and state."""

    def __init__(self, *, parameter_overrides: list[Parameter] | None = None, **node_options: Any) -> None:
        """Raise ParameterError or SupervisionError, in one line, for bad parameters. `done`: exit status."""
        super().__init__("supervisor_node", parameter_overrides=parameter_overrides, **node_options)
        self._values = declare(self, SUPERVISOR)
        nodes = [name for name in self._values["nodes"] if name]
        self._answers = Answers(nodes, self._values["answer_time"], 2.0 * TURN)
        self._supervision = Supervision(self._answers, [name for name in self._values["needed"] if name])
        levels = {
            name: Levels(*(self._values[f"{name}_{kind}"] for kind in ("warning", "abort"))) for name in QUANTITIES
        }
        contact = self._values["contact_acceleration"], self._values["contact_dead_time"]
        self._quantities = QuantityWatch(Limits(levels), contact, self._on_passed)
        self._situation: Situation | None = None
        self.done: Future = Future()
        self.error = ""
        self._make_topics()

    def _make_topics(self) -> None:
        self._events = EventPublisher(self)
        self._states = self.create_publisher(SupervisorState, "supervisor/state", STATES)
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)
        self._questions = NodeQuestions(self, self._answers)
        self._check = LoopChecker(self, self._answers.nodes, self._values["scene"], self._values["check_time"])
        for topic in SENSORS:
            subscribe(self, SampleBlock, topic, self._on_block, BLOCKS)
        subscribe(self, CeilingState, "ceiling/state", self._on_state, STATES)
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.create_service(Trigger, "~/rearm", self._on_rearm)
        self.create_service(Trigger, "~/check", self._on_check)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._own_timers = [
            self.create_timer(TURN, self._turn, clock=steady),
            self.create_timer(1.0, self._check_alone, clock=steady),
        ]

    def _turn(self) -> None:
        now = time.monotonic()
        for change in self._answers.check(now):
            self._report(change)
        self._questions.ask(now)
        self._publish(now)
        lost = self._supervision.given_up(now, self._values["give_up"])
        if lost:
            silence = self._answers.silence(lost, now)
            self._end(f"{lost} has not answered for {self._values['give_up']:g} s: the run ends", silence)
        self._check_loop(now)

    def _check_loop(self, now: float) -> None:
        before = self._check.passed
        found = self._check.turn(now)
        for line in found:
            self._events.publish(Event.ALARM, Event.ABORT, f"loop check: {line}")
        if found:
            self._stop(f"loop check: {'; '.join(found)}")
            self._end(f"loop check: {'; '.join(found)}", float(len(found)))
        elif self._check.passed and not before:
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
        held = "the ceiling is held, without heartbeats" if needed else "the run goes on"
        severity = Event.ALARM if needed else Event.WARNING
        text = f"{change.name} {why} for {change.silence:.2f} s: {held}"
        self._events.publish(severity, Event.STALE, text, change.silence)

    def _publish(self, now: float) -> None:
        """Publish the state; an event and diagnostics at once where it has changed."""
        situation = self._supervision.situation()
        message = SupervisorState(state=int(situation.state), permit=situation.permit, stop=situation.stop)
        message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), self.get_name()
        message.reason, message.nodes = situation.reason, list(self._answers.nodes)
        message.silence = [self._answers.silence(name, now) for name in self._answers.nodes]
        self._states.publish(message)
        before, self._situation = self._situation, situation
        if before is None or before.state != situation.state:
            text = f"{situation.state.name.lower()}{': ' if situation.reason else ''}{situation.reason}"
            expected = situation.permit or situation.state in (State.STARTING, State.SHUTDOWN)
            severity = Event.INFO if expected else Event.ALARM
            self._events.publish(severity, Event.SUPERVISION, text)
            self._diagnostics.publish()

    def _on_block(self, block: SampleBlock) -> None:
        if not block.handshake:
            self._check.on_block(block, time.monotonic())
            self._quantities.on_block(block, time.monotonic())

    def _on_state(self, state: CeilingState) -> None:
        if not state.handshake:
            self._quantities.on_motor(state.mode in (CeilingState.HOMING, CeilingState.MOVING), time.monotonic())

    def _on_passed(self, passed: Passed) -> None:
        if passed.severity is Severity.WARNING:
            self._events.publish(Event.WARNING, Event.LIMIT, str(passed), passed.value)
            return
        self._stop(str(passed))
        self._events.publish(Event.ALARM, Event.ABORT, f"{passed}: motor off", passed.value)

    def _stop(self, reason: str) -> None:
        if self._supervision.stop(reason):
            self._publish(time.monotonic())  # now: the motor need not wait for the next turn

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop on request of the operator: motor off until `~/rearm`."""
        self._stop("stopped by the operator")
        response.success, response.message = True, f"motor off: {self._supervision.stopped}; ~/rearm arms it again"
        return response

    def _on_rearm(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Clear a stop or an abort whose cause is gone, and activate the motor; only on request of a person."""
        above = self._quantities.still_above()
        problem = f"{', '.join(above)}: still above the abort level" if above else self._supervision.rearm()
        response.success, response.message = not problem, problem or "cleared; the motor is armed, and homed if needed"
        if not problem:
            self._quantities.rearm()
            self._publish(time.monotonic())
            self._questions.rearm_motor()
        return response

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
        level = LEVELS.get(situation.state, DiagnosticStatus.ERROR)
        return [status(self, "supervision", level, situation.reason or situation.state.name.lower(), values)]

    def _check_alone(self) -> None:
        if started_twice(self) and not self.done.done():
            self.done.set_result(BAD_INPUT)

    def close(self) -> None:
        """Withdraw the permission; stop the timers."""
        self._supervision.end()
        if self.context.ok():
            self._publish(time.monotonic())
        self._diagnostics.cancel()
        for timer in self._own_timers:
            timer.cancel()


#: Runs the supervisor as a process of its own; returns the exit status.
main = partial(run_node, SupervisorNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
