# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recorder as a source of samples follows it: a source reports one that has gone, and at its end waits for the bag.

A source leaves when everything published is delivered and the recorder, unless it has gone, has closed its bag.
"""

import time
from collections.abc import Callable, Iterable

from atpid_interfaces.msg import Event, RecorderStatus
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import STATUS, STEADY
from atpid_common.nodes.parameters import Publish

GONE_AFTER = 5.0  # the recorder publishes its status once a second; one that is silent for so long is gone [s]
_PERIOD = 0.5  # between two checks [s]
_CLOSING_PERIOD = 0.05  # between two checks whether the bag is closed [s]
_DELIVERY = 1.0  # how long a subscriber may take to receive the last messages [s]


class RecorderWatch:
    """State of the recorder: not there, recording, closed, or gone."""

    def __init__(self, node: Node, on_status: Callable[[RecorderStatus], None], report: Publish, *, expected: bool):
        """Subscribe. `report` is called when the recorder has gone and when it is back, where it is `expected`."""
        self._on_status, self._report = on_status, report
        self.status: RecorderStatus | None = None
        self._received = 0.0  # steady [s]
        self._gone = False
        subscribe(node, RecorderStatus, "recorder/status", self._receive, STATUS)
        self._timer = node.create_timer(_PERIOD, self._check, clock=STEADY)
        if not expected:
            self._timer.cancel()

    @property
    def silent(self) -> float:
        """How long ago the last status came [s]; 0 before the first."""
        return time.monotonic() - self._received if self.status is not None else 0.0

    @property
    def gone(self) -> bool:
        """Whether there was a recorder that is silent now."""
        return self.silent > GONE_AFTER

    @property
    def recording(self) -> bool:
        """Whether the recorder is there and has a bag open."""
        return self.status is not None and self.status.recording and not self.gone

    def cancel(self) -> None:
        """Stop the timer."""
        self._timer.cancel()

    def _receive(self, status: RecorderStatus) -> None:
        silent, self._received = self.silent, time.monotonic()
        self.status = status
        if self._gone:
            self._gone = False
            self._report(Event.INFO, Event.RESUMED, f"the recorder is back after {silent:.1f} s", silent)
        self._on_status(status)

    def _check(self) -> None:
        if self._gone or not self.gone:
            return
        self._gone = True
        assert self.status is not None
        text = (
            f"no status of the recorder for {self.silent:.1f} s: does it still run? What comes now may not be in "
            f"{self.status.bag}"
        )
        self._report(Event.WARNING, Event.STALE, text, self.silent)


class Leaving:
    """Sets `done`, the node's exit status, once."""

    def __init__(self, node: Node, publishers: Callable[[], Iterable[Publisher]], held: Callable[[], bool]) -> None:
        """Do nothing yet. `held`: whether the recorder still writes what was published."""
        self._node, self._publishers, self._held = node, publishers, held
        self.done: Future = Future()
        self.status: int | None = None  # None: the run goes on

    def when_recorded(self, status: int) -> None:
        """Leave with `status` as soon as the recorder has closed its bag."""
        self.status = status
        self._timer = self._node.create_timer(_CLOSING_PERIOD, self._check, clock=STEADY)

    def at_once(self, status: int) -> None:
        """Leave with `status` as soon as everything published is delivered."""
        self.status = status
        for publisher in self._publishers():
            publisher.wait_for_all_acked(Duration(seconds=_DELIVERY))
        if not self.done.done():
            self.done.set_result(status)

    def _check(self) -> None:
        if not self._held() and self.status is not None:
            self._timer.cancel()
            self.at_once(self.status)
