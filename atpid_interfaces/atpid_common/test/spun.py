# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes under test and a peer that publishes, receives and asks, on one executor in a context of their own."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from atpid_common.nodes.turns import TurnExecutor
from atpid_common.testing import own_domain, spin_until


class Spun:
    """Nodes of these names, of which the last is the peer; `contextlib.closing` closes all."""

    def __init__(self, *names: str, gather: float = 0.0) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.executor = TurnExecutor(gather, context=self.context)
        self.added: list[Any] = []
        for name in names:
            self.add(Node(name, context=self.context))
        self.node, self.peer = self.added[0], self.added[-1]

    def add(self, node: Any) -> Any:
        """Let a node take part until the end; return it."""
        self.added.append(node)
        self.executor.add_node(node)
        return node

    def make(self, kind: Callable[..., Any], parameters: dict[str, Any], **options: Any) -> Any:
        """Return a node of a class, with parameters."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return self.add(kind(parameter_overrides=overrides, context=self.context, **options))

    def until(self, happened: Callable[[], object], act: Callable[[], object] = lambda: None) -> None:
        spin_until(self.executor, happened, act)

    def wait(self, future: Any, act: Callable[[], object] = lambda: None) -> Any:
        self.until(future.done, act)
        return future.result()

    def call(self, name: str, kind: Any = Trigger, **request: Any) -> Any:
        client = self.peer.create_client(kind, name)
        self.until(client.service_is_ready)
        answer = client.call_async(kind.Request(**request))
        self.until(answer.done)
        self.peer.destroy_client(client)
        return answer.result()

    def close(self) -> None:
        for node in self.added:
            getattr(node, "close", lambda: None)()
            node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


class Apart(Spun):
    """In a domain of its own."""

    def __init__(self, name: str = "peer") -> None:
        self._domain = ExitStack()
        self._domain.enter_context(own_domain())
        super().__init__(name)

    def close(self) -> None:
        super().close()
        self._domain.close()
