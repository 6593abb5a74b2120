# SPDX-License-Identifier: Apache-2.0
"""The life of a node as a process: run until interrupted, end in order, say what is wrong in one line."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from atpid_driver.errors import DriverError
from atpid_driver.nodes.twice import StartedTwiceError, claim

BAD_INPUT = 2
TURN_S = 0.1
"""How soon an interrupt is noticed at the latest."""


def run(make: Callable[[], Node], name: str, args: list[str] | None) -> int:
    """Run a node until it is interrupted. Returns 0, or 2 for bad parameters or a node started twice."""
    interrupted = threading.Event()
    # rclpy's own handlers shut the context down under a callback that is just publishing; `ros2 launch` may
    # interrupt twice, and the second must not cut the ending short.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: interrupted.set())
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # arguments rcl cannot use, for example a parameter file that is not there
        return _refuse(name, error)
    node: Node | None = None
    try:
        node = make()
        with claim(node.get_fully_qualified_name()):
            _spin(node, interrupted)
    except (DriverError, StartedTwiceError) as error:
        return _refuse(name, error)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: Node, interrupted: threading.Event) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not interrupted.is_set():
        executor.spin_once(timeout_sec=TURN_S)
    executor.shutdown()


def _refuse(name: str, error: Exception) -> int:
    print(f"{name}: {str(error).splitlines()[0]}", file=sys.stderr)
    return BAD_INPUT
