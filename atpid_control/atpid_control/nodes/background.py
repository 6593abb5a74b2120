# SPDX-License-Identifier: Apache-2.0
"""Awaits a computation in an executor of `concurrent.futures`, so that a node's callbacks go on meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TypeVar

from rclpy.node import Node
from rclpy.task import Future

T = TypeVar("T")


async def computed(node: Node, executor: Executor, compute: Callable[[], T]) -> T:
    """Return what `compute` returns, or raise what it raises; to be awaited in a callback of `node`.

    The callback has to be in a ReentrantCallbackGroup, else it holds up the other callbacks of its group.
    """
    result = executor.submit(compute)
    if not result.done():
        finished = Future()

        def wake(_: object) -> None:
            finished.set_result(None)
            if node.executor is not None:
                node.executor.wake()

        result.add_done_callback(wake)
        await finished
    return result.result()
