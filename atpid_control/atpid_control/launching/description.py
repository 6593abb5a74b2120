# SPDX-License-Identifier: Apache-2.0
"""Launch descriptions: arguments are checked before any node starts, and all nodes have to run.

A node that fails, or ends early, ends the launch with status 1. The others are then stopped before the recorder, whose
bag has their last events. After Ctrl-C the terminal itself sends SIGINT to all of them at once.
"""

import re
import signal
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription, Substitution
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.conditions import IfCondition
from launch.event import Event
from launch.event_handler import EventHandler
from launch.events import matches_action
from launch.events.process import ProcessExited, ProcessStarted, ShutdownProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from atpid_common.errors import AtpidError
from atpid_control.launching.arguments import START, Argument, check, check_names, parameter_file
from atpid_control.security import enclave_arguments

PACKAGE = "atpid_control"


def describe(launch_file: str, arguments: Sequence[Argument], *entities: Any) -> LaunchDescription:
    """Return the description of `launch_file`: first the check of its arguments, then what it starts."""
    checking = OpaqueFunction(function=_check, args=[Path(launch_file), arguments])
    return LaunchDescription([checking, *map(_declared, arguments), supervision(), *entities])


def config(package: str, name: str) -> PathJoinSubstitution:
    """Return the parameter file `name` that `package` installs."""
    return PathJoinSubstitution([FindPackageShare(package), "config", name])


def text(argument: str) -> ParameterValue:
    """Return a launch argument as a text parameter, whatever it looks like."""
    return ParameterValue(LaunchConfiguration(argument), value_type=str)


def texts(*arguments: str) -> ParameterValue:
    """Return launch arguments as a parameter that is a list of texts."""
    return ParameterValue([[LaunchConfiguration(argument)] for argument in arguments], value_type=list[str])


def live_page() -> "GraphNode":
    """Return the node of the live page, where `live:=true` asks for it."""
    page = {
        "scene": text("scene"),
        "host": text("live_host"),
        "port": ParameterValue(LaunchConfiguration("live_port"), value_type=int),
    }
    return GraphNode(
        PACKAGE,
        "live_node",
        config(PACKAGE, "live.yaml"),
        page,
        optional=True,
        condition=IfCondition(LaunchConfiguration("live")),
    )


class ReplayParameters(Substitution):
    """The parameter file for the replay of the bag that the launch arguments name."""

    def __init__(self) -> None:
        super().__init__()
        self._path = ""

    def perform(self, context: LaunchContext) -> str:
        """Write it, for the first of the nodes, and return its path."""
        self._path = self._path or parameter_file(context.launch_configurations)
        return self._path


def _declared(argument: Argument) -> DeclareLaunchArgument:
    default: Any = config("atpid_driver", argument.file) if argument.file else argument.default
    choices = list(argument.choices) or None
    return DeclareLaunchArgument(
        argument.name, default_value=default, description=argument.description, choices=choices
    )


def _check(context: LaunchContext, launch_file: Path, arguments: Sequence[Argument]) -> None:
    """Put the values to use in place of those given; LaunchArgumentError ends the launch before its first node."""
    # `launch` gets SIGINT by set_wakeup_fd; a KeyboardInterrupt as well would tear a callback that starts a node
    signal.signal(signal.SIGINT, lambda *_: None)
    if _on_command_line(launch_file):
        check_names(launch_file.name, arguments, [word.partition(":=")[0] for word in context.argv])
    context.launch_configurations.update(check(launch_file.name, arguments, context.launch_configurations))


def _on_command_line(launch_file: Path) -> bool:
    """Return whether `ros2 launch` was asked for this very file, so that every argument given is meant for it.

    Where another launch file includes this one, the arguments on the command line are the other's.
    """
    words = sys.argv[1:]
    by_package = (PACKAGE, launch_file.name) in pairwise(words)
    named = [path for path in map(Path, words) if path.name == launch_file.name and path.exists()]
    return by_package or any(path.samefile(launch_file) for path in named)


#: asyncio's exit status of a process whose own is lost: that it had ended was noticed first by the sending of a signal.
_NOT_KNOWN = 255
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


class GraphNode(Node):
    """A node whose end ends the launch: well, if `ends_run` and its exit status is 0."""

    def __init__(
        self, package: str, executable: str, *parameters: Any, ends_run: bool = False, ends_last: bool = False,
        optional: bool = False, **options: Any,
    ) -> None:  # fmt: skip
        """Take parameter files and values.

        ends_run: the run ends with it; ends_last: it is stopped after the others; optional: the run goes on without it.
        """
        self.label, self.ends_run, self.ends_last, self.optional = executable, ends_run, ends_last, optional
        super().__init__(
            package=package,
            executable=executable,
            exec_name=executable,
            parameters=list(parameters),
            ros_arguments=enclave_arguments(executable),
            prefix=[StartPrefix(executable)],
            output="screen",
            on_exit=self._on_exit,
            sigterm_timeout=str(SIGTERM_TIMEOUT),
            sigkill_timeout=str(SIGKILL_TIMEOUT),
            **options,
        )

    def _on_exit(self, event: ProcessExited, _context: LaunchContext) -> EmitEvent:
        # judged by an event of its own, after a Ctrl-C that arrived together with this end
        return EmitEvent(event=NodeEnded(self, event.returncode))


class NodeEnded(Event):
    """The process of a node has ended."""

    name = "atpid_control.launching.NodeEnded"

    def __init__(self, node: GraphNode, status: int) -> None:
        """Keep the node and its exit status (negative: the signal)."""
        self.node, self.status = node, status


def supervision() -> LaunchDescription:
    """Return the actions that judge the end of each node."""
    supervisor = Supervisor()
    handlers = (
        (lambda e: isinstance(e, ProcessStarted) and isinstance(e.action, GraphNode), supervisor.on_start),
        (lambda e: isinstance(e, NodeEnded), supervisor.on_end),
    )
    return LaunchDescription([
        RegisterEventHandler(EventHandler(matcher=matcher, entities=[OpaqueFunction(function=act)]))
        for matcher, act in handlers
    ])  # fmt: skip


class Supervisor:
    """Ends a launch when one of its nodes has ended; an exception is how `launch` ends with a status other than 0."""

    def __init__(self) -> None:
        self._running: list[GraphNode] = []
        self._outcome: NodeEndedError | str = ""  # why the launch ends; empty: it goes on

    def on_start(self, context: LaunchContext) -> list[EmitEvent]:
        """Take a node that has started; stop it where the launch is ending."""
        started: GraphNode = context.locals.event.action
        self._running.append(started)
        return self._stopped([started]) if self._outcome else []

    def on_end(self, context: LaunchContext) -> list[Any]:
        """Judge a node that has ended: stop the others, those that end last when only they are left."""
        ended: NodeEnded = context.locals.event
        if ended.node in self._running:
            self._running.remove(ended.node)
        stopping = bool(self._outcome) or context.is_shutdown
        if ended.node.optional and not stopping:
            return [
                LogInfo(msg=f"{ended.node.label} ended with exit status {ended.status}; the run goes on without it")
            ]
        outcome = _outcome_of(ended, stopping=stopping, shutdown=context.is_shutdown)
        if outcome and not isinstance(self._outcome, NodeEndedError):
            self._outcome = outcome
        if context.is_shutdown:
            return self._concluded(shutdown=True)
        others = [node for node in self._running if not node.ends_last]
        if not others:
            return self._concluded(shutdown=False)
        return [] if stopping else self._stopped(others)

    def _stopped(self, nodes: Sequence[GraphNode]) -> list[EmitEvent]:
        return [EmitEvent(event=ShutdownProcess(process_matcher=matches_action(node))) for node in nodes]

    def _concluded(self, *, shutdown: bool) -> list[Any]:
        """Raise the error the launch ends with, once, or shut down what is left."""
        outcome = self._outcome
        if isinstance(outcome, NodeEndedError):
            self._outcome = str(outcome)
            raise outcome
        return [] if shutdown else [Shutdown(reason=outcome)]


def _outcome_of(ended: NodeEnded, *, stopping: bool, shutdown: bool) -> NodeEndedError | str:
    """Return why the launch ends with this node; empty: it does not, for the node was being stopped."""
    name, status = ended.node.label, ended.status
    if shutdown and status == -signal.SIGINT:
        return ""  # interrupted before `START` could block it: the node had not begun
    if stopping and status == _NOT_KNOWN:
        return ""
    if status != 0:
        rest = " while it was being stopped" if stopping else "; the launch ends"
        how = f"ended with exit status {status}" if status > 0 else f"was ended by {signal.Signals(-status).name}"
        return NodeEndedError(f"{name} {how}{rest}")
    if stopping:
        return ""
    if ended.node.ends_run:
        return f"{name} has finished the run"
    return NodeEndedError(f"{name} ended by itself (exit status 0) before the run was over; the launch ends")
