# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Prevents two nodes of one name: two plants would drive one loop, two motor nodes would move one ceiling."""

import os
import socket
import time
from weakref import WeakKeyDictionary

from rclpy.node import Node

from atpid_common.claim import claimed
from atpid_common.errors import InputError

#: Discovery keeps a node that has left for a moment, and one that is refused its claim on this machine is in the graph
#: until its libraries are loaded, which takes seconds beside other programs; only one that stays longer counts [s].
_TRANSIENT = 10.0
_first_seen: WeakKeyDictionary[Node, float] = WeakKeyDictionary()


class StartedTwiceError(InputError):
    """A node of the same name is already running."""


def claim(name: str) -> socket.socket:
    """Hold the fully qualified `name` in this ROS domain on this machine until the socket returned is closed.

    So no time is lost waiting for discovery. Raises StartedTwiceError.
    """
    holder = claimed(f"{os.environ.get('ROS_DOMAIN_ID', '0')}{name}")
    if holder is None:
        raise StartedTwiceError(_text(name))
    return holder


def is_alone(node: Node) -> bool:
    """Return whether discovery shows no other node of this fully qualified name now, on other machines either."""
    seen: list[tuple[str, str]] = node.get_node_names_and_namespaces()
    return seen.count((node.get_name(), node.get_namespace())) <= 1


def started_twice(node: Node) -> bool:
    """Return whether another node of this name stays in the graph, which is logged; to be called repeatedly.

    One that is started on this machine is refused its claim and leaves at once, so a short appearance does not count.
    """
    if is_alone(node):
        _first_seen.pop(node, None)
        return False
    twice = time.monotonic() - _first_seen.setdefault(node, time.monotonic()) > _TRANSIENT
    if twice:
        node.get_logger().error(_text(node.get_fully_qualified_name()))
    return twice


def _text(name: str) -> str:
    return (
        f"{name} is already running in this ROS domain: stop it first, or give this one another name "
        "(--ros-args -r __node:=NAME) or another ROS_DOMAIN_ID"
    )
