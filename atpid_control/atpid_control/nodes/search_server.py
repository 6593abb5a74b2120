# SPDX-License-Identifier: Apache-2.0
"""The action `~/search` (SearchHeight): a step search on the running structure, with feedback and cancel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from atpid_interfaces.action import SearchHeight
from atpid_interfaces.msg import SampleBlock
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.nodes.messages import BLOCKS, nanoseconds_of
from atpid_control.selection.search import Plan, SearchError
from atpid_control.selection.search_run import Progress, SearchingController, SearchRun

_BEAM = "beam_displacement"


class SearchServer:
    """Hands goals to the searching controller and the beam to its search; `report` after each answered estimate."""

    def __init__(self, node: Node, controller: SearchingController) -> None:
        """Serve on a node whose controller may be interrupted."""
        self._node, self._controller = node, controller
        self._goal: ServerGoalHandle | None = None
        self._ended: Future | None = None
        self._told = -1
        self._start_ns: int | None = None
        node.create_subscription(SampleBlock, "sensors/laser", self._on_block, BLOCKS)
        self._server = ActionServer(
            node,
            SearchHeight,
            "~/search",
            execute_callback=self._execute,
            goal_callback=self._asked,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def report(self) -> None:
        """Publish feedback when a new height was watched; end the goal when the search has ended or was cancelled."""
        run, goal = self._controller.run, self._goal
        if goal is None or self._ended is None or self._ended.done():
            return
        if goal.is_cancel_requested and run is not None:
            run.stop("cancelled")
        found = run.progress() if run is not None else None
        if found is not None and found.iterations != self._told:
            self._told = found.iterations
            goal.publish_feedback(_feedback(found))
        if found is None or found.done:
            self._ended.set_result(None)

    def close(self) -> None:
        """Take the action down; a second time does nothing."""
        if self._server in self._node.waitables:
            self._server.destroy()

    def _asked(self, goal: SearchHeight.Goal) -> GoalResponse:
        """Refuse, with the reason in the log, what cannot be searched."""
        try:
            self._controller.begin(Plan(goal.step, goal.dwell, goal.lowest, goal.highest))
        except SearchError as error:
            self._node.get_logger().warning(f"search refused: {error}")
            return GoalResponse.REJECT
        self._told = -1
        return GoalResponse.ACCEPT

    async def _execute(self, goal: ServerGoalHandle) -> SearchHeight.Result:
        run = self._controller.run
        self._goal, self._ended = goal, Future()
        await self._ended
        self._goal = None
        if goal.is_cancel_requested:
            goal.canceled()
        elif run is not None and run.success:
            goal.succeed()
        else:
            goal.abort()
        return _result(run)

    def _on_block(self, block: SampleBlock) -> None:
        if block.handshake or not block.data:
            return
        begin = nanoseconds_of(block.header.stamp)
        if self._start_ns is None:
            self._start_ns = begin
        values = np.frombuffer(block.data, dtype=np.float64).reshape(-1, len(block.channels))
        beam = values[:, list(block.channels).index(_BEAM)] if _BEAM in block.channels else np.array([math.nan])
        self._controller.watch((begin - self._start_ns) * 1e-9 + len(values) / block.rate, beam)


def _feedback(found: Progress) -> Any:
    return SearchHeight.Feedback(
        iteration=found.iterations,
        height=found.height,
        beam_amplitude=found.amplitude,
        best_height=found.best_height,
    )


def _result(run: SearchRun | None) -> Any:
    if run is None:
        return SearchHeight.Result(success=False, message="no search")
    found = run.progress()
    return SearchHeight.Result(
        success=run.success,
        message=found.message,
        height=found.best_height,
        beam_amplitude=found.best_amplitude,
        iterations=found.iterations,
    )
