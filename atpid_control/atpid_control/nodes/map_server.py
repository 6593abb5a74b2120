# SPDX-License-Identifier: Apache-2.0
"""The action `~/compute_map` (ComputeMap): a height map made while the node goes on, with progress and cancel."""

from __future__ import annotations

import threading
import time
from typing import Any

from atpid_interfaces.action import ComputeMap
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.errors import InputError
from atpid_sim.maps import build_map
from atpid_sim.scene import load_scene

#: How often a client hears how far the map is [s].
_PERIOD = 0.5


class _StoppedError(InputError):
    """The goal was cancelled, or the node goes down."""


class _Making:
    """One map in a thread of its own; what is done lies in the map's journal, so a stop costs one point."""

    def __init__(self, goal: ComputeMap.Goal) -> None:
        self.done, self.total = 0, len(goal.amplitudes) * len(goal.mass_fractions)
        self.began, self.message, self.success = time.monotonic(), "", False
        self._goal, self._stop = goal, threading.Event()
        self.thread = threading.Thread(target=self._make, name="compute_map")
        self.thread.start()

    def _make(self) -> None:
        goal = self._goal
        try:
            build_map(load_scene(goal.scene), list(goal.amplitudes), list(goal.mass_fractions), goal.out, self._note)
        except (ValueError, ArithmeticError, OSError) as error:
            self.message = str(error)
            return
        self.success, self.message = True, f"{goal.out}: {self.total} best heights"

    def _note(self, done: int, total: int) -> None:
        self.done, self.total = done, total
        if self._stop.is_set():
            raise _StoppedError(f"stopped after {done} of {total} points; the same call goes on from there")

    def stop(self) -> None:
        """Ask it to end after the point it is at."""
        self._stop.set()

    def remaining(self) -> float:
        """Return the time to go [s], as far as the points done tell."""
        return (time.monotonic() - self.began) * (self.total - self.done) / max(1, self.done)


class MapServer:
    """Serves the action on a node; one map at a time."""

    def __init__(self, node: Node) -> None:
        """Serve."""
        self._node = node
        self._making: _Making | None = None
        self._goal: ServerGoalHandle | None = None
        self._ended: Future | None = None
        # the node's own turn publishes: a thread that makes maps must not touch the middleware
        self._timer = node.create_timer(_PERIOD, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._server = ActionServer(
            node,
            ComputeMap,
            "~/compute_map",
            execute_callback=self._execute,
            goal_callback=self._asked,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def close(self) -> None:
        """Stop a map that is being made, and take the action down; a second time does nothing."""
        if self._making:
            self._making.stop()
            self._making.thread.join()
        if self._server in self._node.waitables:
            self._server.destroy()

    def _asked(self, goal: ComputeMap.Goal) -> GoalResponse:
        if self._making is not None:
            self._node.get_logger().warning("map refused: one is being made; cancel it first")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _report(self) -> None:
        making, goal, ended = self._making, self._goal, self._ended
        if making is None or goal is None or ended is None or ended.done():
            return
        if goal.is_cancel_requested:
            making.stop()
        goal.publish_feedback(ComputeMap.Feedback(done=making.done, total=making.total, remaining=making.remaining()))
        if not making.thread.is_alive():
            ended.set_result(None)

    async def _execute(self, goal: ServerGoalHandle) -> ComputeMap.Result:
        self._goal, self._ended, self._making = goal, Future(), _Making(goal.request)
        await self._ended
        making, self._making, self._goal = self._making, None, None
        making.thread.join()
        if goal.is_cancel_requested:
            goal.canceled()
        elif making.success:
            goal.succeed()
        else:
            goal.abort()
        return _result(making, goal.request.out)


def _result(making: _Making, out: str) -> Any:
    wall = time.monotonic() - making.began
    return ComputeMap.Result(success=making.success, message=making.message, out=out, wall_time=wall)
