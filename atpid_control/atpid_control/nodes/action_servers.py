# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The selector's actions: `~/search`, a step search on the running structure, and `~/compute_map`, a height map.

Both have feedback and cancel, and the node goes on meanwhile. Every goal is accepted; one that cannot be searched or
computed is aborted, since only a result carries the reason.
"""

import math
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Executor
from typing import TypeVar

import numpy as np
from atpid_interfaces.action import ComputeMap, SearchHeight
from atpid_interfaces.msg import SampleBlock
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.errors import AtpidError, InputError
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import BLOCKS, STEADY, channels_of, nanoseconds_of, scans_of
from atpid_control.loop.protocol import threaded
from atpid_control.loop.search_run import SearchMode, SearchRun
from atpid_control.selection.search import Plan, SearchError
from atpid_sim.maps import HeightMap, MapError, build_map
from atpid_sim.maps.response import HIGHEST_RATIO, LOWEST_RATIO
from atpid_sim.scene import load_scene

R = TypeVar("R", SearchHeight.Result, ComputeMap.Result)


class SearchServer:
    """Passes goals to the controller's search mode, the beam to its search; `report` after each answered estimate."""

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
            return _concluded(goal, _no_result(str(error)))
        self._goal, self._ended, self._reported = goal, Future(), -1
        # only now: receiving every block costs the loop time
        blocks = subscribe(self._node, SampleBlock, "sensors/laser", self._on_block, BLOCKS)
        await self._ended
        self._node.destroy_subscription(blocks)
        self._goal = self._ended = None
        return _concluded(goal, _result(run))

    def _on_block(self, block: SampleBlock) -> None:
        start_ns = self._start_ns()
        if block.handshake or not block.data or start_ns is None:
            return
        beam = channels_of(block).get("beam_displacement", np.array([math.nan]))
        begin = nanoseconds_of(block.header.stamp) - start_ns
        self._search.watch(begin * 1e-9 + scans_of(block) / block.rate, beam)


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


def _concluded(goal: ServerGoalHandle, result: R) -> R:
    """Put a goal in its final state, by `result.success` unless it was cancelled; return the result."""
    if goal.is_cancel_requested:
        goal.canceled()
    elif result.success:
        goal.succeed()
    else:
        goal.abort()
    return result


#: Period of the feedback [s].
_PERIOD = 0.5


class _StoppedError(InputError):
    """The goal was cancelled, or the node is shut down."""


class _MapJob:
    """One map being computed; points computed are in its journal, so a stop costs one point."""

    def __init__(self, goal: ComputeMap.Goal, executor: Executor) -> None:
        layers = max(1, len(goal.frequency_ratios))
        self.done, self.total = 0, len(goal.amplitudes) * len(goal.mass_fractions) * layers
        self.began = time.monotonic()
        self.stop = threading.Event()  # set: it ends after the present point
        self.result = executor.submit(self._make, goal)

    def _make(self, goal: ComputeMap.Goal) -> tuple[bool, str]:
        """Make the map; return whether it was made, and what it holds or why it was not."""
        try:
            grid, ratios = (list(goal.amplitudes), list(goal.mass_fractions)), _ratios_of(goal)
            made = build_map(load_scene(goal.scene), *grid, goal.out, self._on_point, frequency_ratios=ratios)
        except (AtpidError, OSError) as error:
            return False, str(error)  # not the error itself, whose traceback would keep a stopped map's threads
        return True, summary_of(made, goal.out)

    def _on_point(self, done: int, total: int) -> None:
        self.done, self.total = done, total
        if self.stop.is_set():
            raise _StoppedError(f"stopped after {done} of {total} points; the same call goes on from there")

    def remaining(self) -> float:
        """Return the time to go [s], extrapolated from the points done."""
        return (time.monotonic() - self.began) * (self.total - self.done) / max(1, self.done)


class MapServer:
    """Serves the action on a node; one map at a time."""

    def __init__(self, node: Node) -> None:
        self._node = node
        # one thread of lower priority than the loop, which the threads it starts inherit
        self._executor = threaded("compute-map")
        self._job: _MapJob | None = None
        self._goal: ServerGoalHandle | None = None
        self._ended: Future | None = None
        # published by the node's timer: the thread that makes maps must not use the middleware
        self._timer = node.create_timer(_PERIOD, self._report, clock=STEADY)
        accept = CancelResponse.ACCEPT
        self._server = ActionServer(node, ComputeMap, "~/compute_map", self._execute, cancel_callback=lambda _: accept)

    def close(self) -> None:
        """Stop a map that is being made, and destroy the action; idempotent."""
        if self._job:
            self._job.stop.set()
        self._executor.shutdown(cancel_futures=True)
        if self._server in self._node.waitables:
            self._server.destroy()

    def _report(self) -> None:
        job, goal, ended = self._job, self._goal, self._ended
        if job is None or goal is None or ended is None or ended.done():
            return
        if goal.is_cancel_requested:
            job.stop.set()
        goal.publish_feedback(ComputeMap.Feedback(done=job.done, total=job.total, remaining=job.remaining()))
        if job.result.done():
            ended.set_result(None)

    async def _execute(self, goal: ServerGoalHandle) -> ComputeMap.Result:
        if self._job is not None:
            busy = "another map is being computed; cancel it or wait for its result"
            return _concluded(goal, ComputeMap.Result(success=False, message=busy, out=goal.request.out))
        self._goal, self._ended, self._job = goal, Future(), _MapJob(goal.request, self._executor)
        await self._ended
        job, self._job, self._goal = self._job, None, None
        return _concluded(goal, self._result(job, goal.request.out))

    def _result(self, job: _MapJob, out: str) -> ComputeMap.Result:
        defect = job.result.exception()
        if defect is not None:  # reported, and the loop goes on
            self._node.get_logger().error("".join(traceback.format_exception(defect)))
            success, message = False, f"internal error: {type(defect).__name__}: {defect}"
        else:
            success, message = job.result.result()
        wall = time.monotonic() - job.began
        return ComputeMap.Result(success=success, message=message, out=out, wall_time=wall)


def _ratios_of(goal: ComputeMap.Goal) -> list[float] | None:
    """Return the frequency ratios of a goal [-]; None: it has none. Raises MapError beyond those heights are for."""
    ratios = list(goal.frequency_ratios)
    beyond = [ratio for ratio in ratios if not LOWEST_RATIO <= ratio <= HIGHEST_RATIO]
    if beyond:
        allowed = f"rising numbers from {LOWEST_RATIO:g} to {HIGHEST_RATIO:g}, or none for the scene's frequency"
        raise MapError(f"frequency ratios: given {beyond[0]:g}; allowed: {allowed}")
    return ratios or None


def summary_of(made: HeightMap, out: str) -> str:
    """Return how many best heights a map holds, and how many of its points are missing or of no use."""
    computed = made.heights.size - len(made.failures)
    text = f"{out}: {computed} best heights"
    irregular = computed - int(np.count_nonzero(made.reproducible))
    useless = int(np.count_nonzero(made.efficiencies <= 0.0))
    text += f", {irregular} of them not reproducible" if irregular else ""
    text += f", {useless} of them without effect (efficiency not above 0)" if useless else ""
    return f"{text}; {made.lost}" if made.lost else text
