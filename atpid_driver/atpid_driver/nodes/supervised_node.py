# SPDX-License-Identifier: Apache-2.0
"""A node of a device that moves something: it starts only where it is alone and permitted, and is off otherwise."""

import time
from collections.abc import Callable
from math import nan
from typing import Any

from atpid_interfaces.msg import Event
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import STEADY, time_of
from atpid_driver import DriverError
from atpid_driver.excitation.settings import ExcitationSettings
from atpid_driver.motor.settings import MotorSettings
from atpid_driver.nodes.authority import DuplicateNodes, MotionPermit
from atpid_driver.nodes.device_node import DeviceNode

RETRY = 1.0
PERMIT_RETRY = 0.1  # between two looks whether motion is permitted
#: What leads from a lifecycle state to an active node.
REMEDIES = {
    "unconfigured": "configure and activate it",
    "inactive": "activate it",
    "finalized": "it was shut down for good; start it again",
}


class SupervisedNode(DeviceNode):
    """What motor and exciter share; the subclass sets what is declared here, and calls `_begin`."""

    settings: MotorSettings | ExcitationSettings
    _permit: MotionPermit
    _off: Callable[[], None]  # switches the device off and confirms it

    def __init__(self, name: str, device: str, **kwargs: Any) -> None:
        """Begin; device: what is switched off, in messages."""
        super().__init__(name, **kwargs)
        self._device = device
        self._connected = self._active = False
        self._stamp = 0  # of the last message that is answered, in lockstep the time [ns]
        self._duplicates = DuplicateNodes(self)
        self._events = EventPublisher(self)

    def _begin(self) -> None:
        """Look for duplicates and offer the stop from now on; start where no lifecycle manager does."""
        self.create_service(Trigger, "~/stop", self._on_stop)
        self.create_timer(1.0, self._check_duplicates, clock=STEADY)
        if self.settings.autostart:
            self._starter = self.create_timer(0.01, self._start, clock=STEADY)

    def _start(self) -> None:
        """Configure until the device answers, then activate once: one that refuses needs a person."""
        assert self._starter is not None
        if not self._connected:
            self.trigger_configure()
        if self._connected and not self._duplicates.inhibits_motion and self._permit.granted:
            self._end_starting()
            self.trigger_activate()
        else:
            waiting = self._connected and not self._duplicates.inhibits_motion
            self._starter.timer_period_ns = int((PERMIT_RETRY if waiting else RETRY) * 1e9)

    def _check_duplicates(self) -> None:
        if (found := self._duplicates.check()) is None:
            return
        severity, text = found
        self._publish_event(severity, Event.DUPLICATE, nan, text)
        if severity == Event.ALARM and self._active:
            self.trigger_deactivate()
            if self.settings.autostart:
                self._starter = self.create_timer(RETRY, self._start, clock=STEADY)

    def _state_and_remedy(self) -> str:
        label = str(self._state_machine.current_state[1])
        return f"{label}: {REMEDIES.get(label, 'activate it')}"

    def _stop(self, reason: str) -> None:
        """Switch the device off, once; it stays off until the node is activated again."""
        self._end_starting()
        if self._active:
            self.trigger_deactivate()
            self._publish_event(Event.ALARM, Event.STOPPED, nan, f"{self._device} switched off: {reason}")

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop at once on request of the operator: the answer is the device's own state."""
        self._stop("stopped by the operator")
        try:
            if self._connected:
                self._off()  # confirmed before, or once more
        except DriverError as error:
            response.success, response.message = False, str(error)
        else:
            again = "supervisor_node/rearm" if self._permit.supervised else "activating the node"
            response.success, response.message = True, f"{self._device} off; {again} arms it again"
        return response

    def _publish_event(self, severity: int, kind: str, value: float, text: str) -> None:
        stamp = time_of(self._stamp) if self.settings.lockstep else None
        self._events.publish(severity, kind, text, value, stamp)

    def _now(self) -> int:
        """Return the time the device goes by [ns]: the last message's stamp in lockstep, else the steady clock."""
        return self._stamp if self.settings.lockstep else time.monotonic_ns()
