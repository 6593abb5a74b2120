# SPDX-License-Identifier: Apache-2.0
"""Between bags and rclpy: message classes by name, quality of service, and the parameters a bag holds."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future

from atpid_control.bags import Qos
from atpid_control.bags.definitions import split_name
from atpid_control.bags.topics import Topic

#: Messages kept per topic while the recorder is busy: 50 s of blocks at 20 a second.
DEPTH = 1000


def class_of(name: str) -> type[Any]:
    """Return the class of the message type "pkg/msg/Name"; raise TypeUnknownError for a name of another form."""
    package, message = split_name(name)
    found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), message)
    return found


def subscription_qos(topic: Topic) -> QoSProfile:
    """Return the quality of service a recorder requests for `topic`."""
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if topic.best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local else DurabilityPolicy.VOLATILE,
    )


def qos_of(profile: QoSProfile) -> Qos:
    """Return a profile as a bag describes it; DDS does not announce history and depth: the recorder's are taken."""
    known = profile.history in (HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL)
    return Qos(
        depth=profile.depth or DEPTH,
        reliability=profile.reliability.short_key,
        durability=profile.durability.short_key,
        history=profile.history.short_key if known else "keep_last",
        deadline_ns=profile.deadline.nanoseconds,
        lifespan_ns=profile.lifespan.nanoseconds,
        liveliness=profile.liveliness.short_key,
        lease_ns=profile.liveliness_lease_duration.nanoseconds,
    )


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
                client.call_async(ListParameters.Request()).add_done_callback(partial(self._request_values, name))

    def _request_values(self, name: str, answer: Future) -> None:
        listed = [key for key in answer.result().result.names if not key.startswith(_OF_RCLPY)]
        client = self._client(GetParameters, name, "get_parameters")
        request = GetParameters.Request(names=listed)
        client.call_async(request).add_done_callback(partial(self._take_values, name, listed, client))

    def _take_values(self, name: str, listed: Sequence[str], client: Client, answer: Future) -> None:
        values = map(parameter_value_to_python, answer.result().values)
        plain = (v if v is None or isinstance(v, bool | int | float | str) else list(v) for v in values)
        self._keep(name, dict(zip(listed, plain, strict=False)))
        self._node.destroy_client(client)
        self._node.destroy_client(self._open.pop(name))

    def _client(self, kind: Any, name: str, service: str) -> Client:
        return self._node.create_client(kind, f"{name}/{service}")
