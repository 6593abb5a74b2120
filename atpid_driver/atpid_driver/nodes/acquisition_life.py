# SPDX-License-Identifier: Apache-2.0
"""The life of a node as a process: run until interrupted, end in order, say what is wrong in one line."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from atpid_driver.errors import DriverError
from atpid_driver.nodes.twice import StartedTwiceError, claim

BAD_INPUT = 2


def run(make: Callable[[], Node], name: str, args: list[str] | None) -> int:
    """Run a node until it is interrupted. Returns 0, or 2 for bad parameters or a node started twice."""
    rclpy.init(args=args)
    node: Node | None = None
    try:
        node = make()
        with claim(node.get_fully_qualified_name()):
            rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except (DriverError, StartedTwiceError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return BAD_INPUT
    finally:
        _end(node)
    return 0


def _end(node: Node | None) -> None:
    """Close down even if a second interrupt arrives meanwhile: `ros2 launch` may send two."""
    for act in (*((node.destroy_node,) if node else ()), rclpy.try_shutdown):
        try:
            act()
        except KeyboardInterrupt:
            act()
