# SPDX-License-Identifier: Apache-2.0
"""Reads the parameters of the graph's nodes, so that a bag holds the values in force."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

#: Parameters that rclpy declares for every node.
_OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")

Keep = Callable[[str, Mapping[str, Any]], None]


class ParameterReader:
    """Gets the parameters of each node once, as soon as its services are there."""

    def __init__(self, node: Node, names: Sequence[str], keep: Keep) -> None:
        """Take the nodes' names; `keep` is called with a node's name and its parameters."""
        self._node, self._keep = node, keep
        self._open = {name: self._client(ListParameters, name, "list_parameters") for name in names}
        self._requested: set[str] = set()

    def poll(self) -> None:
        """Request the parameters of nodes that have appeared since; to be called periodically."""
        for name, client in self._open.items():
            if name not in self._requested and client.service_is_ready():
                self._requested.add(name)
                client.call_async(ListParameters.Request()).add_done_callback(self._on_names(name))

    def _on_names(self, name: str) -> Callable[[Future], None]:
        def request_values(answer: Future) -> None:
            listed = [key for key in answer.result().result.names if not key.startswith(_OF_RCLPY)]
            client = self._client(GetParameters, name, "get_parameters")
            request = GetParameters.Request(names=listed)
            client.call_async(request).add_done_callback(self._on_values(name, listed, client))

        return request_values

    def _on_values(self, name: str, listed: Sequence[str], client: Client) -> Callable[[Future], None]:
        def keep(answer: Future) -> None:
            values = map(parameter_value_to_python, answer.result().values)
            self._keep(name, {key: _plain(value) for key, value in zip(listed, values, strict=False)})
            self._node.destroy_client(client)
            self._node.destroy_client(self._open.pop(name))

        return keep

    def _client(self, kind: Any, name: str, service: str) -> Client:
        return self._node.create_client(kind, f"{name}/{service}")


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)
