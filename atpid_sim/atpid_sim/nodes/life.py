# SPDX-License-Identifier: Apache-2.0
"""The life of a node that is its own process: one claim of its name, one line for bad input, Ctrl-C once or twice."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from typing import Protocol, cast

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future

from atpid_sim.nodes.twice import claim

BAD_INPUT, NUMERICAL_FAILURE = 2, 3


class LastingNode(Protocol):
    """A node that may end by itself: `done` holds its exit status, `close` leaves everything in order."""

    done: Future

    def close(self) -> None:
        """Say what has to be said before the node is destroyed."""
        ...


def run(make: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Run the node that `make` returns until it is done or interrupted; return the exit status."""
    rclpy.init(args=args)
    node = None
    try:
        node = make()
        holder = claim(node.get_fully_qualified_name())
        with holder:
            rclpy.spin_until_future_complete(node, cast(LastingNode, node).done)
        done = cast(LastingNode, node).done
        return int(done.result()) if done.done() else 0
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except (ValueError, ArithmeticError) as error:
        # bad input has an error of our own; a plain ValueError is a mistake in the program and keeps its traceback
        if not type(error).__module__.startswith("atpid_"):
            raise
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, ValueError) else NUMERICAL_FAILURE
    finally:
        leave(node)


def leave(node: Node | None) -> None:
    """Close and destroy the node; `ros2 launch` may send a second SIGINT meanwhile, which must not cut this short."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if node is not None:
        cast(LastingNode, node).close()
        node.destroy_node()
    rclpy.try_shutdown()
