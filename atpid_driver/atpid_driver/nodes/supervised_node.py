# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node of a device that moves something: it starts only where it is alone and permitted, and is off otherwise."""

import time
from collections.abc import Callable
from math import nan
from typing import ClassVar

from atpid_interfaces.msg import Event
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import EVENTS, STATES, STEADY, time_of
from atpid_common.nodes.supervision import NodeMonitors
from atpid_driver import DriverError, NotReadyError
from atpid_driver.nodes.authority import CommandGate, DuplicateNodes, MotionPermit
from atpid_driver.nodes.device_node import DeviceNode
from atpid_driver.settings import SupervisedSettings

_RETRY = 1.0
_PERMIT_RETRY = 0.1  # between two looks whether motion is permitted
#: What leads from a lifecycle state to an active node.
_REMEDIES = {
    "unconfigured": "configure and activate it",
    "inactive": "activate it",
    "finalized": "it was shut down for good; start it again",
}


class SupervisedNode(DeviceNode):
    """What motor and exciter share; the subclass sets what is declared here, and calls `_open_topics` and `_begin`."""

    #: Name of the device in messages, topics of its commands and states, and what is done without commands.
    DEVICE: ClassVar[str]
    COMMANDS: ClassVar[str]
    STATE: ClassVar[str]
    SILENCE: ClassVar[str]
    settings: SupervisedSettings
    _on_command: Callable[..., None]
    _each_period: Callable[[], None]
    _statuses: Callable[[], list[DiagnosticStatus]]
    _halt: Callable[[], None]  # ends what moves; the next command moves it again
    _off: Callable[[], None]  # switches the device off and confirms it
    _rearm: Callable[[], str]  # arms an active one again; returns in words what it does then

    def __init__(self, name: str, **kwargs: object) -> None:
        super().__init__(name, **kwargs)
        self._connected = self._active = False
        self._stopped = ""  # why it is off until a person arms it; empty: it is not
        self._stamp = 0  # of the last message that is answered, in lockstep the time [ns]
        self._duplicates = DuplicateNodes(self)
        self._events = EventPublisher(self)

    def _open_topics(self, command: type, state: type, depth: int) -> None:
        """Follow commands and publish states; in real time also those of an own period, as the supervisor permits."""
        settings, in_time = self.settings, not self.settings.lockstep
        self._supervision = NodeMonitors(
            self, self._events.publish, self._statuses, settings.stale_timeout, self._on_silence, enabled=in_time
        )
        self._supervision.stale.watch(self.COMMANDS, self.SILENCE)
        qos = self._supervision.qos
        self._states = self.create_publisher(state, self.STATE, STATES, event_callbacks=qos.publisher(self.STATE))
        callbacks = qos.subscription(self.COMMANDS)
        subscribe(self, command, self.COMMANDS, self._on_command, depth, event_callbacks=callbacks)
        self._gate = CommandGate(self, self.COMMANDS, settings, self._publish_event)
        supervised = settings.supervised and in_time
        self._permit = MotionPermit(self, self._stop, settings.supervision_timeout, supervised=supervised)
        if in_time:
            subscribe(self, Event, "events", self._on_event, EVENTS)
            self.create_timer(1.0 / settings.rate, self._each_period, clock=STEADY)

    def _on_event(self, event: Event) -> None:
        if event.kind == Event.STARTED:
            self._gate.restart()

    def _on_silence(self) -> None:
        if self._supervision.stale.stale:
            self._halt()

    def _check_permitted(self) -> None:
        """Raise NotReadyError where nothing may be switched on."""
        if self._duplicates.inhibits_motion:
            raise NotReadyError(f"{self.get_fully_qualified_name()} runs twice in this ROS graph: stop the other one")
        if not self._permit.granted:
            raise NotReadyError(f"no motion is permitted: {self._permit.reason}")

    def _check_command(self, what: str, info: dict[str, int]) -> None:
        """Raise NotReadyError or CommandStaleError where `what` is commanded and may not move anything now."""
        if not self._active:
            raise NotReadyError(f"{what} refused: the {self.DEVICE} node is {self._state_and_remedy()}")
        if not self._permit.granted:
            self._gate.void()  # it does not wait until motion is permitted again
            raise NotReadyError(f"{what} not taken up: {self._permit.reason}")
        self._gate.check_fresh(info, self._now())

    def _is_foreign(self, value: float, info: dict[str, int], decision: object = None) -> bool:
        """Return whether a command, of `value`, is not of the sender that is followed; beside another nothing moves."""
        if not self._gate.is_foreign(info, decision):
            return False
        if self._gate.commander.several:
            self._halt()
        self._gate.report_foreign(value)
        return True

    def _begin(self) -> None:
        """Look for duplicates and offer the stop from now on; start where no lifecycle manager does."""
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.create_service(Trigger, "~/rearm", self._on_rearm)
        self.create_timer(1.0, self._check_duplicates, clock=STEADY)
        if self.settings.autostart:
            self._starter = self.create_timer(0.01, self._start, clock=STEADY)

    def _start(self) -> None:
        """Configure until the device answers, then activate once: one that refuses needs a person."""
        assert self._starter is not None
        if not self._connected:
            self.trigger_configure()
        if self._connected and self._may_start:
            self._end_starting()
            self.trigger_activate()
        else:
            waiting = self._connected and not self._duplicates.inhibits_motion
            self._starter.timer_period_ns = int((_PERMIT_RETRY if waiting else _RETRY) * 1e9)

    @property
    def _may_start(self) -> bool:
        return not self._duplicates.inhibits_motion and self._permit.granted

    def _check_duplicates(self) -> None:
        if (found := self._duplicates.check()) is None:
            return
        severity, text = found
        self._publish_event(severity, Event.DUPLICATE, nan, text)
        if severity == Event.ALARM and self._active:
            self.trigger_deactivate()
            if self.settings.autostart:
                self._starter = self.create_timer(_RETRY, self._start, clock=STEADY)

    def _state_and_remedy(self) -> str:
        label = str(self._state_machine.current_state[1])
        return f"{label}: {_REMEDIES.get(label, 'activate it')}"

    def _stop(self, reason: str) -> None:
        """Switch the device off, once; it stays off until the node is activated again."""
        self._end_starting()
        if self._active:
            self._stopped = f"{reason}; {self.get_name()}/rearm arms it again"
            self.trigger_deactivate()
            severity = Event.INFO if self._permit.ending else Event.ALARM
            self._publish_event(severity, Event.STOPPED, nan, f"{self.DEVICE} switched off: {reason}")

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop at once on request of the operator: the answer is the device's own state."""
        self._stop("stopped by the operator")
        try:
            if self._connected:
                self._off()  # confirmed before, or once more
        except DriverError as error:
            response.success, response.message = False, str(error)
        else:
            first = "supervisor_node/rearm" if self.DEVICE == "motor" and self._permit.supervised else None
            again = first or f"{self.get_name()}/rearm"
            response.success, response.message = True, f"{self.DEVICE} off; {again} arms it again"
        return response

    def _on_rearm(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Arm it, whatever has stopped it, where the cause is gone; only on request of a person."""
        try:
            self._check_permitted()
            response.success, response.message = True, self._rearm() if self._active else self._armed_from_off()
        except DriverError as error:
            response.success, response.message = False, str(error)
        return response

    def _armed_from_off(self) -> str:
        """Configure the node where that is needed, and activate it. Raises NotReadyError with the reason why not."""
        label = str(self._state_machine.current_state[1])
        steps = {"unconfigured": (self.trigger_configure, self.trigger_activate), "inactive": (self.trigger_activate,)}
        for step in steps.get(label, ()):
            step()
        if not self._active:
            raise NotReadyError(self._last_error or f"the {self.DEVICE} node is {self._state_and_remedy()}")
        return "armed"

    def _publish_event(self, severity: int, kind: str, value: float, text: str) -> None:
        stamp = time_of(self._stamp) if self.settings.lockstep else None
        self._events.publish(severity, kind, text, value, stamp)

    def _now(self) -> int:
        """Return the time the device goes by [ns]: the last message's stamp in lockstep, else the steady clock."""
        return self._stamp if self.settings.lockstep else time.monotonic_ns()
