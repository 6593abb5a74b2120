# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Prevents two nodes of one name: two plants would drive one loop, two motor nodes would move one ceiling."""

import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from weakref import WeakKeyDictionary

from rclpy.node import Node

from atpid_common.errors import InputError
from atpid_common.middleware import claimed

#: Discovery keeps a node that has left for a moment; only one that stays longer counts [s].
_TRANSIENT = 10.0
_first_seen: WeakKeyDictionary[Node, float] = WeakKeyDictionary()


class StartedTwiceError(InputError):
    """A node of the same name is already running."""


def claim(name: str) -> socket.socket:
    """Hold the fully qualified `name` in this ROS domain on this machine until the socket returned is closed.

    So no time is lost waiting for discovery. Raises StartedTwiceError.
    """
    holder = claimed(_in_domain(name))
    if holder is None:
        raise StartedTwiceError(_text(name))
    return holder


@contextmanager
def starting() -> Iterator[None]:
    """Hold, while this program makes a node, which is in the graph before it is refused its claim: `started_twice`."""
    holder = claimed(_starting())
    try:
        yield
    finally:
        if holder is not None:
            holder.close()


def is_alone(node: Node) -> bool:
    """Return whether discovery shows no other node of this fully qualified name now, on other machines either."""
    seen: list[tuple[str, str]] = node.get_node_names_and_namespaces()
    return seen.count((node.get_name(), node.get_namespace())) <= 1


def started_twice(node: Node) -> bool:
    """Return whether another node of this name stays in the graph, which is logged; to be called repeatedly.

    One that is started on this machine is refused its claim and leaves, so a short appearance does not count, nor the
    time in which this program is starting once more: on a busy machine it may load for a minute.
    """
    if is_alone(node) or _starts_again():
        _first_seen.pop(node, None)
        return False
    twice = time.monotonic() - _first_seen.setdefault(node, time.monotonic()) > _TRANSIENT
    if twice:
        node.get_logger().error(_text(node.get_fully_qualified_name()))
    return twice


def _starts_again() -> bool:
    probe = claimed(_starting())
    if probe is None:
        return True
    with closing(probe):
        return False


def _starting() -> str:
    return _in_domain(f" starting {Path(sys.argv[0]).stem}")


def _in_domain(name: str) -> str:
    return f"{os.environ.get('ROS_DOMAIN_ID', '0')}{name}"


def _text(name: str) -> str:
    return (
        f"{name} is already running in this ROS domain: stop it first, or give this one another name "
        "(--ros-args -r __node:=NAME) or another ROS_DOMAIN_ID"
    )
