# SPDX-License-Identifier: Apache-2.0
"""Refuse to run beside a node of the same name: two plants would feed one loop, two selectors command one ceiling."""

from __future__ import annotations

import os
import socket
import time
from weakref import WeakKeyDictionary

from rclpy.node import Node

#: How long a namesake may be in the graph before it counts: discovery keeps one that has just left for a moment [s].
_PASSING = 2.0
_seen: WeakKeyDictionary[Node, float] = WeakKeyDictionary()


class StartedTwiceError(ValueError):
    """A node of the same name is already running."""


def claim(name: str) -> socket.socket:
    """Hold the fully qualified `name` in this ROS domain on this machine until the socket returned is closed.

    A Linux abstract socket: the kernel lets go of it even after a kill, at once and without a file, so that no time is
    lost waiting for discovery. Raises `StartedTwiceError`.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0atpid/{os.environ.get('ROS_DOMAIN_ID', '0')}{name}")
    except OSError:
        holder.close()
        raise StartedTwiceError(_said(name)) from None
    return holder


def is_alone(node: Node) -> bool:
    """Whether discovery shows no other node of this name now, other machines included."""
    return bool(node.get_node_names_and_namespaces().count((node.get_name(), node.get_namespace())) <= 1)


def check_alone(node: Node) -> None:
    """Raise `StartedTwiceError` where another node of this name stays in the graph; to be called now and then.

    One that was started on this machine is refused its claim and leaves at once, so it must not drive this one out.
    """
    if is_alone(node):
        _seen.pop(node, None)
    elif time.monotonic() - _seen.setdefault(node, time.monotonic()) > _PASSING:
        raise StartedTwiceError(_said(node.get_fully_qualified_name()))


def _said(name: str) -> str:
    return (
        f"{name} is already running in this ROS domain: stop it first, or give this one another name "
        "(--ros-args -r __node:=NAME) or another ROS_DOMAIN_ID"
    )
