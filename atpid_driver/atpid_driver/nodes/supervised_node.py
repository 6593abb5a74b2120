# SPDX-License-Identifier: Apache-2.0
"""A node of a device that moves something: it starts only where it is alone and permitted, and is off otherwise."""

from collections.abc import Callable
from math import nan
from typing import Any

from atpid_interfaces.msg import Event

from atpid_common.nodes.messages import STEADY
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
    """What motor and exciter share; the subclass sets `_permit`, `_connected` and `_active`, and calls `_begin`."""

    _permit: MotionPermit
    _publish_event: Callable[[int, str, float, str], None]

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self._connected = self._active = self._autostart = False
        self._duplicates = DuplicateNodes(self)

    def _begin(self, *, autostart: bool) -> None:
        """Look for duplicates from now on; autostart: configure and activate without a lifecycle manager."""
        self._autostart = autostart
        self.create_timer(1.0, self._check_duplicates, clock=STEADY)
        if autostart:
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
            if self._autostart:
                self._starter = self.create_timer(RETRY, self._start, clock=STEADY)

    def _state_and_remedy(self) -> str:
        label = str(self._state_machine.current_state[1])
        return f"{label}: {REMEDIES.get(label, 'activate it')}"
