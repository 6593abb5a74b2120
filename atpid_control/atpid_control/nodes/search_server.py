# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The action `~/search` (SearchHeight): a step search on the running structure, with feedback and cancel."""

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from atpid_interfaces.action import ComputeMap, SearchHeight
from atpid_interfaces.msg import SampleBlock
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import BLOCKS, nanoseconds_of
from atpid_control.loop.search_run import SearchMode, SearchRun
from atpid_control.selection.search import Plan, SearchError

_BEAM = "beam_displacement"
R = TypeVar("R", SearchHeight.Result, ComputeMap.Result)


class SearchServer:
    """Passes goals to the controller's search mode and the beam to its search; `report` after each answered estimate.

    Every goal is accepted; one that cannot be searched is aborted, since only a result carries the reason.
    """

    def __init__(self, node: Node, search: SearchMode, start_ns: Callable[[], int | None]) -> None:
        """Serve on a node whose controller has this search mode.

        start_ns: returns the stamp the controller's time counts from [ns]; None: it has answered no estimate yet.
        """
        self._node, self._search, self._start_ns = node, search, start_ns
        self._goal: ServerGoalHandle | None = None
        self._ended: Future | None = None
        self._reported = -1
        self._server = ActionServer(node, SearchHeight, "~/search", self._execute, cancel_callback=self._on_cancel)

    def report(self) -> None:
        """Publish feedback after each height; end the goal when the search has ended."""
        run, goal = self._search.run, self._goal
        if goal is None or self._ended is None or self._ended.done():
            return
        if run is not None and run.search.iterations != self._reported:
            self._reported = run.search.iterations
            feedback = SearchHeight.Feedback(iteration=run.search.iterations, best_height=run.search.best_height)
            feedback.height, feedback.beam_amplitude = run.height, run.amplitude
            goal.publish_feedback(feedback)
        if run is None or run.done:
            self._ended.set_result(None)

    def stop(self, reason: str) -> None:
        """End a running search without a result, also where no estimates come."""
        run, ended = self._search.run, self._ended
        if ended is None or ended.done():
            return
        if run is not None:
            run.stop(reason)
        ended.set_result(None)

    def close(self) -> None:
        """Destroy the action; idempotent."""
        if self._server in self._node.waitables:
            self._server.destroy()

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        if self._goal is not None and goal.goal_id == self._goal.goal_id:
            self.stop("cancelled")
        return CancelResponse.ACCEPT

    async def _execute(self, goal: ServerGoalHandle) -> SearchHeight.Result:
        request = goal.request
        try:
            run = self._search.begin(Plan(request.step, request.dwell, request.lowest, request.highest))
        except SearchError as error:
            return concluded(goal, _no_result(str(error)))
        self._goal, self._ended, self._reported = goal, Future(), -1
        # only now: receiving every block costs the loop time
        blocks = subscribe(self._node, SampleBlock, "sensors/laser", self._on_block, BLOCKS)
        await self._ended
        self._node.destroy_subscription(blocks)
        self._goal = self._ended = None
        return concluded(goal, _result(run))

    def _on_block(self, block: SampleBlock) -> None:
        start_ns = self._start_ns()
        if block.handshake or not block.data or start_ns is None:
            return
        values = np.frombuffer(block.data, dtype=np.float64).reshape(-1, len(block.channels))
        beam = values[:, list(block.channels).index(_BEAM)] if _BEAM in block.channels else np.array([math.nan])
        begin = nanoseconds_of(block.header.stamp) - start_ns
        self._search.watch(begin * 1e-9 + len(values) / block.rate, beam)


def _result(run: SearchRun) -> SearchHeight.Result:
    found = run.search
    if found.iterations == 0:
        return _no_result(run.message)
    best = f"the best of {found.iterations} heights was {found.best_height:.4f} m"
    return SearchHeight.Result(
        success=run.success,
        message=run.message if run.success else f"{run.message}; {best}",
        height=found.best_height,
        beam_amplitude=found.best_amplitude,
        iterations=found.iterations,
    )


def _no_result(message: str) -> SearchHeight.Result:
    return SearchHeight.Result(success=False, message=message, height=math.nan, beam_amplitude=math.nan)


def concluded(goal: ServerGoalHandle, result: R) -> R:
    """Put a goal in its final state, by `result.success` unless it was cancelled; return the result."""
    if goal.is_cancel_requested:
        goal.canceled()
    elif result.success:
        goal.succeed()
    else:
        goal.abort()
    return result
