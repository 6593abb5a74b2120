# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a launch file does: it starts the command of its name, which supervises the nodes, and ends as that does."""

import signal
import sys
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited

from atpid_common.errors import AtpidError
from atpid_control.stand.launching.options import Argument, arguments_of, check_names, is_asked_for, words_of

PACKAGE = "atpid_control"
#: The command begins with signals blocked, so that Ctrl-C while Python starts is neither lost nor a traceback, and is
#: sent SIGTERM where its launch dies; it then stops the nodes in order.
START = ["env", "--block-signal=INT", "--block-signal=TERM", "--block-signal=HUP", "setpriv", "--pdeathsig", "TERM"]
#: How long it may take to end after SIGINT before it is sent SIGTERM, which a stop under way ignores, and then to stop
#: its nodes one after the other and to make its report before it is killed [s].
SIGTERM_TIMEOUT, SIGKILL_TIMEOUT = 5.0, 300.0


class CommandEndedError(AtpidError):
    """The command of a launch file that another one includes has ended with another status than 0."""


def describe(launch_file: str) -> LaunchDescription:
    """Return the description of `COMMAND.launch.py`: its arguments are the options of the command."""
    file = Path(launch_file)
    command = file.name.partition(".")[0]
    starting = OpaqueFunction(function=_start, args=[file, command])
    return LaunchDescription([*map(_declared, arguments_of(command)), starting])


def _declared(argument: Argument) -> DeclareLaunchArgument:
    choices = ["", *argument.choices] if argument.choices else None
    return DeclareLaunchArgument(
        argument.name, default_value=argument.default, description=argument.description, choices=choices
    )


def _start(context: LaunchContext, file: Path, command: str) -> list[ExecuteProcess]:
    """Return the command's process; LaunchArgumentError ends the launch instead."""
    # `launch` gets SIGINT by set_wakeup_fd; a KeyboardInterrupt as well would tear a callback that starts a process
    signal.signal(signal.SIGINT, lambda *_: None)
    given = dict(context.launch_configurations)
    alone = is_asked_for(file, sys.argv[1:])
    if alone:
        check_names(command, [word.partition(":=")[0] for word in context.argv])
    elif not given.get("namespace"):  # that of the group in which the other file includes this one
        given["namespace"] = given.get("ros_namespace", "")
    program = Path(get_package_prefix(PACKAGE)) / "bin" / "atpid"

    def end(event: ProcessExited, _context: LaunchContext) -> Any:
        if alone:  # there is nothing else to end; `launch` itself has no way to end with a status of one's own
            raise SystemExit(event.returncode)
        if event.returncode:
            raise CommandEndedError(f"{command} ended with exit status {event.returncode}")
        return Shutdown(reason=f"{command} has ended")

    process = ExecuteProcess(
        cmd=[*START, str(program), *words_of(command, given)],
        name=command,
        output="screen",
        on_exit=end,
        sigterm_timeout=str(SIGTERM_TIMEOUT),
        sigkill_timeout=str(SIGKILL_TIMEOUT),
    )
    return [process]
