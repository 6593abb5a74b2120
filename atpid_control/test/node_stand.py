# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes of tests on one executor of their own, which is turned until what is waited for has come."""

from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from atpid_common.nodes.turns import TurnExecutor
from atpid_common.testing import spin_until


class NodeStand:
    """Nodes by these names; `wait` and `until` turn the executor."""

    def __init__(self, *names: str) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(context=self.context)
        self.nodes = [Node(name, context=self.context) for name in names]
        for node in self.nodes:
            self.executor.add_node(node)

    def until(self, condition: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        spin_until(self.executor, condition, act)

    def wait(self, future: Any, act: Callable[[], object] = lambda: None) -> Any:
        self.until(future.done, act)
        return future.result()

    def close(self) -> None:
        for node in list(self.executor.get_nodes()):
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)
