# SPDX-License-Identifier: Apache-2.0
"""The node of a command: in the graph while the command runs, whatever way it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

N = TypeVar("N", bound=Node)


@contextmanager
def command_node(make: Callable[[], N]) -> Iterator[tuple[N, SingleThreadedExecutor]]:
    """Initialise rclpy without signal handlers of its own; yield the node that `make` returns, and its executor."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node, executor = make(), SingleThreadedExecutor()
        executor.add_node(node)
        try:
            yield node, executor
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
