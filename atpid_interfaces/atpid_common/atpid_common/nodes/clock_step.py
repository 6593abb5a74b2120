# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steps of the wall clock while a node spins: the executor is woken, and the step is logged.

The middleware of the wheels waits until a time of the wall clock, so a wait that is under way while the clock is set
back lasts longer by the step, and timers on the steady clock wait with it. Later waits are right.
"""

import threading
import time

from rclpy.executors import Executor
from rclpy.node import Node

#: How often the clocks are compared, and the least difference that is a step [s].
PERIOD, LEAST = 0.05, 0.02
_UNDISTURBED = 0.002  # a longer reading of both clocks was interrupted [s]


class ClockStepWatch:
    """Compares wall and steady clock in a thread of its own, whose waits are on the steady clock."""

    def __init__(self, node: Node, executor: Executor) -> None:
        self._node, self._executor = node, executor
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="clock step watch", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        before = _wall_ahead()
        while not self._stop.wait(PERIOD):
            now = _wall_ahead()
            if abs(now - before) > LEAST:
                self._executor.wake()
                self._node.get_logger().warning(f"the wall clock was set by {now - before:+.3f} s")
            before = now


def _wall_ahead() -> float:
    """Return by how much the wall clock is ahead of the steady one [s]."""
    while True:
        begin = time.monotonic()
        wall = time.time()
        if time.monotonic() - begin < _UNDISTURBED:
            return wall - begin
