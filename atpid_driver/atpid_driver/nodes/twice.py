# SPDX-License-Identifier: Apache-2.0
"""Refuse to run beside a node of the same name: two motor nodes would both move one ceiling."""

from __future__ import annotations

import os
import socket

from rclpy.node import Node


class StartedTwiceError(ValueError):
    """A node of the same name is already running."""


def claim(name: str) -> socket.socket:
    """Hold the name in this ROS domain on this machine until the returned socket is closed or the process ends.

    A Linux abstract socket: the kernel lets go of it even after a kill, at once and without a file.
    Raises `StartedTwiceError`.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0atpid/{os.environ.get('ROS_DOMAIN_ID', '0')}{name}")
    except OSError:
        holder.close()
        raise StartedTwiceError(
            f"{name} is already running in this ROS domain: stop it first, or give this one another name "
            "(--ros-args -r __node:=NAME) or ROS_DOMAIN_ID"
        ) from None
    return holder


def namesakes(node: Node) -> int:
    """Return how many other nodes with this fully qualified name the graph shows, other machines included."""
    own = (node.get_name(), node.get_namespace())
    seen: list[tuple[str, str]] = node.get_node_names_and_namespaces()
    return max(0, seen.count(own) - 1)
