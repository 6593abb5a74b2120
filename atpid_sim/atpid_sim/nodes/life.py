# SPDX-License-Identifier: Apache-2.0
"""The life of a node that is its own process: one claim of its name, one line for bad input, Ctrl-C once or twice."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Protocol, cast

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from atpid_sim.nodes.twice import claim
from atpid_sim.scene import Scene, SceneError, load_scene

#: How soon a signal is noticed at the latest [s].
TURN = 0.1
BAD_INPUT, NUMERICAL_FAILURE = 2, 3


class LastingNode(Protocol):
    """A node that may end by itself: `done` holds its exit status, `close` leaves everything in order."""

    done: Future

    def close(self) -> None:
        """Say what has to be said before the node is destroyed."""
        ...


def run(make: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Run the node that `make` returns until it is done or interrupted; return the exit status."""
    try:
        # rclpy's own handlers take the context away in another thread, under a callback that is just publishing
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # arguments rcl cannot use: a parameter file that is not there, say
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    node = None
    interrupted = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: interrupted.set())
    try:
        node = make()
        with claim(node.get_fully_qualified_name()):
            return _spin(node, interrupted)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except ParameterException as error:
        print(f"error: parameter: {error}", file=sys.stderr)
        return BAD_INPUT
    except (ValueError, ArithmeticError) as error:
        # bad input has an error of our own; a plain ValueError is a mistake in the program and keeps its traceback
        if not type(error).__module__.startswith("atpid_"):
            raise
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, ValueError) else NUMERICAL_FAILURE
    finally:
        _leave(node)


def _spin(node: Node, interrupted: threading.Event) -> int:
    """Spin until the node is done or a signal came; return the exit status."""
    done = cast(LastingNode, node).done
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not done.done() and not interrupted.is_set():
        executor.spin_once(timeout_sec=TURN)
    executor.shutdown()
    return int(done.result()) if done.done() else 0


def scene_given(node: Node) -> Scene:
    """Return the scene the node's parameter `scene` names. Raises SceneError."""
    path = str(node.get_parameter("scene").value)
    if not path:
        raise SceneError(f"parameter scene of {node.get_name()} is not set: give a scene file, -p scene:=SCENE.yaml")
    return load_scene(path)


def _leave(node: Node | None) -> None:
    """Close and destroy the node; a second signal, which `ros2 launch` may send, only sets the flag again."""
    if node is not None:
        cast(LastingNode, node).close()
        node.destroy_node()
    rclpy.try_shutdown()
