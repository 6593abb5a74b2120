# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The motor node: height commands in, ceiling state out; a lifecycle node around one `CeilingActuator`.

configure opens and identifies (motor off), activate arms and homes, deactivate stops (motor off).
In lockstep each command is answered by one state at its stamp; in real time states go out on the node's own period,
and a ceiling that gets no more commands is stopped where it is. Where asked, a run begins only after the ceiling has
moved by a known distance and back. Where it is supervised it moves, and sends its
heartbeat, only while the supervisor permits it.
"""

import sys
import time
from contextlib import suppress
from functools import partial
from math import isfinite, nan

from atpid_interfaces.msg import CeilingCommand, CeilingState, Event
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.task import Future
from std_msgs.msg import Header

from atpid_common.errors import BAD_INPUT, InputError
from atpid_common.injected_faults import Injected
from atpid_common.nodes.messages import nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import LiveParameters
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import Frame, Mode
from atpid_driver import DriverError
from atpid_driver.clock import time_base_ns
from atpid_driver.motor import actuator_of
from atpid_driver.motor.ceiling_actuator import Reading
from atpid_driver.motor.faults import NO_FAULT, HeightRefusedError, StopNotConfirmedError, in_words
from atpid_driver.motor.known_motion import SAME, KnownMotion, KnownMotionError
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.nodes.motor_interface import TABLE, FaultInjection, PlantCeiling, settings_of, state_of, status_of
from atpid_driver.nodes.supervised_node import SupervisedNode

_REAL_TIME_DEPTH, _LOCKSTEP_DEPTH = 1, 10


class MotorNode(SupervisedNode):
    """Moves the ceiling to the heights of `ceiling/command`, in lockstep or in real time: see the module's text."""

    DEVICE, COMMANDS, STATE = "motor", "ceiling/command", "ceiling/state"
    SILENCE = "the ceiling is stopped"
    settings: MotorSettings

    def __init__(self, **kwargs: object) -> None:
        """Declare parameters and topics; nothing is opened. Raises `InputError` for an invalid parameter."""
        super().__init__("motor_node", **kwargs)
        try:
            values = LiveParameters(self, TABLE)
            self.settings = settings_of(values.__getitem__)
            self._actuator = actuator_of(self.settings)
        except InputError:
            self.leave_graph()
            raise
        self._reported = 0  # stamp of the last reading of a real board [ns]
        # a run in lockstep begins at 0; one in real time with its first command, by the steady clock [ns]
        self._injection = FaultInjection(self, 0 if self.settings.lockstep else None)
        self._initial: float | None = None
        self._known_motion = KnownMotion(self.settings.check_move, self.settings.limits)
        self.done: Future = Future()  # of the exit status: this node ends where the known motion fails
        self.error = ""
        self._last_faults, self._last_mode = NO_FAULT, Mode.UNCONFIGURED
        self._open_topics(CeilingCommand, CeilingState, _LOCKSTEP_DEPTH if self.settings.lockstep else _REAL_TIME_DEPTH)
        self._was_granted = self._permit.granted
        self._begin()
        if not self._actuator.placed:
            self._plant_ceiling = PlantCeiling(self, lambda height: self._actuator.place(height, self._now()))
        self._inject(self.settings.injected)
        values.follow(lambda value: settings_of(value).injected, self._inject, self._events.publish)

    def _inject(self, faults: tuple[Injected, ...]) -> None:
        self._actuator = self._injection.change(self._actuator, faults, self._now())

    def _on_event(self, event: Event) -> None:
        self._supervision.on_event(event)
        super()._on_event(event)

    def _configure(self) -> None:
        identity = self._actuator.connect(self._now())
        self._connected = True
        self.get_logger().info(f"connected to {identity}; motor off")

    def _activate(self) -> None:
        self._check_permitted()
        self._arm()
        self._active = True
        wanted = self.settings.initial_height
        self._initial = wanted if isfinite(wanted) and not self.settings.lockstep else None

    def _arm(self) -> None:
        self._actuator.activate(self._now())
        self._gate.armed(self._now())

    def _deactivate(self) -> None:
        """Switch the motor off. One that does not confirm it is inactive all the same: nothing moves it again."""
        self._active, self._initial = False, None
        self._known_motion.restart()
        try:
            self._actuator.deactivate(self._now())
        except StopNotConfirmedError as error:
            self._publish_event(Event.ALARM, Event.STOPPED, nan, str(error))
        self._publish_now()

    def _release(self) -> None:
        self._active = self._connected = False
        self._actuator.close()

    def _on_command(self, command: CeilingCommand, info: dict[str, int]) -> None:
        handshake = command.handshake
        if not handshake and self._is_foreign(command.height, info):
            self._supervision.stale.received(self.COMMANDS)
        elif not handshake:
            before, self._stamp = self._stamp, nanoseconds_of(command.header.stamp)
            self._actuator = self._injection.begin(self._actuator, self._now())
            period = (self._stamp - before) * 1e-9 if before else 0.0
            self._supervision.stale.received(self.COMMANDS, self._stamp, period)
            self._gate.receive(self._stamp, info, object())  # each answers a sample of its own
            self._move(command, info)
        reading = self._read()
        prepared = self._initial is None and self._known_motion.passed
        if (handshake and reading.ready and prepared) or (self.settings.lockstep and not handshake):
            self._publish(reading, command.header.stamp, handshake=handshake)

    def _move(self, command: CeilingCommand, info: dict[str, int]) -> None:
        self._initial = None
        if not self._known_motion.passed:
            self._end("known motion: a height was commanded before it was made; start the source with handshake: true")
        try:
            self._check_command(f"ceiling height {command.height:g} m", info)
            self._actuator.move(command.height, command.sequence, self._now())
        except DriverError as error:
            outside = isinstance(error, HeightRefusedError)
            if outside or isfinite(command.height):  # once, whatever heights a ramp commands to one that is not ready
                self._gate.refuse(command.height if outside else None, command.height, error)
        else:
            self._gate.accepted()

    def _publish_now(self) -> None:
        """Publish that it is off, however soon it is armed again: the supervisor stops the exciter by it."""
        if not self.settings.lockstep:
            reading = self._read()
            self._publish(reading, self._stamp_of(reading))

    def _each_period(self) -> None:
        self._hold_without_permit()
        reading = self._read()
        if self._initial is not None and self._active and reading.ready and self._permit.granted:
            self._go_to_initial(self._initial, reading)
        elif not self._known_motion.passed and self._active and self._initial is None:
            self._move_as_known(reading)
        self._publish(reading, self._stamp_of(reading))

    def _stamp_of(self, reading: Reading) -> Time:
        """Return when a reading was taken: of a real board by its own clock; a repeated one has the stamp it had."""
        if self.settings.backend == "simulated":
            return self.get_clock().now().to_msg()
        taken = reading.steady if isfinite(reading.steady) else time.monotonic()
        self._reported = max(self._reported, time_base_ns() + round(taken * 1e9))
        return time_of(self._reported)

    def _go_to_initial(self, height: float, reading: Reading) -> None:
        """Go to the first height after homing, until it is reached; a command takes precedence."""
        if reading.mode is Mode.HOLDING and abs(reading.target - height) < SAME:
            self._initial = None
            return
        try:
            self._actuator.move(height, 0, self._now())
        except DriverError as error:
            self._report_once(str(error))

    def _move_as_known(self, reading: Reading) -> None:
        """Go on with the known motion, before a run; where it fails, switch the motor off and end the node."""
        motion, now = self._known_motion, time.monotonic()
        if not self._permit.granted:
            motion.restart()
            return
        if not motion.announced and not reading.ready:
            return  # it homes, or waits for a person
        if announcement := motion.announcement(reading.height, now):
            self._publish_event(Event.INFO, Event.SUPERVISION, self.settings.check_move, announcement)
            self._actuator = self._injection.begin(self._actuator, self._now())
        try:
            height = motion.turn(reading, now)
            if isfinite(height):
                self._actuator.move(height, 0, self._now())
        except DriverError as error:
            self._end(str(error) if isinstance(error, KnownMotionError) else f"known motion: {error}")
        else:
            if motion.passed:
                # injected faults begin again with the run
                self._actuator = self._injection.suspend(self._actuator, self._now())
                self._publish_event(Event.INFO, Event.SUPERVISION, self.settings.check_move, "known motion passed")

    def _end(self, text: str) -> None:
        """Switch the motor off and end the node, with a line that gives the reason."""
        if self.done.done():
            return
        self._stop(text)
        self.error = text
        self._publish_event(Event.ALARM, Event.ABORT, nan, text)
        print(f"error: {text}", file=sys.stderr, flush=True)
        self.done.set_result(BAD_INPUT)

    def _hold_without_permit(self) -> None:
        """Stop a moving ceiling as soon as motion is no longer permitted; heartbeats end with it."""
        before, self._was_granted = self._was_granted, self._permit.granted
        if self._active and before and not self._was_granted:
            severity = Event.INFO if self._permit.ending else Event.ALARM
            self._publish_event(severity, Event.SUPERVISION, nan, f"the ceiling is held: {self._permit.reason}")
            self._stop_moving()
            if self._actuator.observe(self._now()).mode is Mode.HOMING:  # which no height interrupts
                self._stop(self._permit.reason)

    def _off(self) -> None:
        self._actuator.deactivate(self._now())

    def _reading(self) -> Reading:
        """Return the ceiling's state; this keeps the heartbeat alive where motion is permitted."""
        actuator = self._actuator
        return actuator.read(self._now()) if self._permit.granted else actuator.observe(self._now())

    def _read(self) -> Reading:
        reading = self._reading()
        for text in self._actuator.reports():
            self._publish_event(Event.WARNING, Event.LINK, nan, text)
        if reading.mode is Mode.MOVING and self._last_mode is not Mode.MOVING:
            text = f"the ceiling moves from {reading.height:.4f} to {reading.target:.4f} m"
            self._publish_event(Event.INFO, Event.MOVED, reading.target, text)
        self._last_mode = reading.mode
        if reading.faults != self._last_faults:
            self._last_faults = reading.faults
            if reading.faults:
                self._publish_event(Event.ALARM, Event.FAULT, reading.height, f"motor off: {in_words(reading.faults)}")
        return reading

    def _publish(self, reading: Reading, stamp: Time, *, handshake: bool = False) -> None:
        header = Header(stamp=stamp, frame_id=Frame.CEILING)
        self._states.publish(state_of(reading, header, handshake=handshake))
        self._injection.publish_truth(self._actuator, reading, header, handshake=handshake)

    def _halt(self) -> None:
        """Stop a moving ceiling: its target may be out of date. The next command moves it again."""
        self._initial = None
        self._stop_moving()

    def _stop_moving(self) -> None:
        if self._active:
            with suppress(DriverError):  # not ready: it does not move
                self._actuator.move(nan, self._reading().sequence, self._now())

    def _statuses(self) -> list[DiagnosticStatus]:
        reading = self._reading()
        return [
            status_of(self, self._actuator, reading, self._last_error, self._gate.latencies),
            self._gate.commander.status(),
        ]

    def _rearm(self) -> str:
        """Clear latched faults whose cause is gone, arm and home."""
        self._publish_now()
        self._arm()
        return "armed; homing if its height is lost"


main = partial(run_node, MotorNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
