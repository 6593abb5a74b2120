# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A node under test, and its peer, on one executor in a context of their own."""

from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from atpid_common.nodes.turns import TurnExecutor
from atpid_common.testing import spin_until


class Spun:
    """One node; `contextlib.closing` closes it."""

    def __init__(self, name: str = "tested", gather: float = 0.0) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(gather, context=self.context)
        self.nodes: list[Node] = []
        self.node = self.add(name)

    def add(self, name: str) -> Node:
        node = Node(name, context=self.context)
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def until(self, happened: Callable[[], Any]) -> None:
        spin_until(self.executor, happened)

    def close(self) -> None:
        for node in self.nodes:
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


class Pair(Spun):
    def __init__(self, gather: float = 0.0) -> None:
        super().__init__(gather=gather)
        self.peer = self.add("peer")
