# SPDX-License-Identifier: Apache-2.0
"""Nodes that all have to run: one that fails, or ends early, ends the launch with status 1."""

from __future__ import annotations

import re
import signal
from collections.abc import Sequence
from typing import Any

from launch import LaunchContext, Substitution
from launch.actions import EmitEvent, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event import Event
from launch.event_handler import EventHandler
from launch.events.process import ProcessExited
from launch_ros.actions import Node

from atpid_common.errors import AtpidError
from atpid_control.launching.launch_files import START

#: How long a node may take to end after SIGINT before it is sent SIGTERM, and after that before it is killed [s].
SIGTERM_TIMEOUT, SIGKILL_TIMEOUT = 5.0, 10.0


class StartPrefix(Substitution):
    """The command before a node's own: `START`, or what `ros2 launch --launch-prefix` gives for this executable."""

    def __init__(self, executable: str) -> None:
        """Keep the executable's name, which `--launch-prefix-filter` is matched with."""
        super().__init__()
        self._executable = executable

    def perform(self, context: LaunchContext) -> str:
        """Return the command."""
        given = context.launch_configurations.get("launch-prefix", "")
        chosen = re.match(context.launch_configurations.get("launch-prefix-filter", ""), self._executable)
        return given if given and chosen else START


class NodeEndedError(AtpidError):
    """A node that ended with an exit status other than 0, or although the run had not ended."""


class NodeEnded(Event):
    """The process of a node has ended."""

    name = "atpid_control.launching.NodeEnded"

    def __init__(self, node: str, status: int, ends_run: bool) -> None:
        """Keep the node's name, its exit status (negative: the signal), and whether its end is that of the run."""
        self.node, self.status, self.ends_run = node, status, ends_run


def node(package: str, executable: str, parameters: Sequence[Any], *, ends_run: bool = False, **options: Any) -> Node:
    """Return a node whose end ends the launch: well, if `ends_run` and its exit status is 0."""

    def on_exit(event: ProcessExited, _context: LaunchContext) -> EmitEvent:
        # judged by an event of its own, after a Ctrl-C that arrived together with this end
        return EmitEvent(event=NodeEnded(executable, event.returncode, ends_run))

    return Node(
        package=package,
        executable=executable,
        exec_name=executable,
        prefix=[StartPrefix(executable)],
        parameters=list(parameters),
        output="screen",
        on_exit=on_exit,
        sigterm_timeout=str(SIGTERM_TIMEOUT),
        sigkill_timeout=str(SIGKILL_TIMEOUT),
        **options,
    )


def supervision() -> RegisterEventHandler:
    """Return the action that judges the end of each `node`."""
    judging = OpaqueFunction(function=_judge)
    return RegisterEventHandler(EventHandler(matcher=lambda event: isinstance(event, NodeEnded), entities=[judging]))


def _judge(context: LaunchContext) -> list[Shutdown]:
    """End the launch; an exception is how `launch` ends with a status other than 0."""
    ended: NodeEnded = context.locals.event
    if context.is_shutdown and ended.status == -signal.SIGINT:
        return []  # interrupted before `START` could block it: the node had not begun
    if ended.status != 0:
        rest = " while it was being stopped" if context.is_shutdown else "; the launch ends"
        raise NodeEndedError(f"{ended.node} {_in_words(ended.status)}{rest}")
    if context.is_shutdown:
        return []
    if ended.ends_run:
        return [Shutdown(reason=f"{ended.node} has finished the run")]
    raise NodeEndedError(f"{ended.node} ended by itself (exit status 0) before the run was over; the launch ends")


def _in_words(status: int) -> str:
    if status > 0:
        return f"ended with exit status {status}"
    return f"was ended by {signal.Signals(-status).name}"
