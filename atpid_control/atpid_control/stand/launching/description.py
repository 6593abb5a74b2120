# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a launch file does: it starts the command of its name, which supervises the nodes, and ends as that does."""

import signal
import sys
from argparse import Action
from itertools import starmap
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited

from atpid_common.errors import AtpidError
from atpid_control.stand.launching.options import arguments_of, check_names, default_of, is_asked_for, words_of

#: The command begins with signals blocked, so that Ctrl-C while Python starts is neither lost nor a traceback, and is
#: sent SIGTERM where its launch dies; it then stops the nodes in order.
_START = ["env", "--block-signal=INT", "--block-signal=TERM", "--block-signal=HUP", "setpriv", "--pdeathsig", "TERM"]
#: How long it may take to end after SIGINT before it is sent SIGTERM, which a stop under way ignores, and then to stop
#: its nodes one after the other and to make its report before it is killed [s].
_SIGTERM_TIMEOUT, _SIGKILL_TIMEOUT = 5.0, 300.0


class _CommandEndedError(AtpidError):
    """The command of a launch file that another one includes has ended with another status than 0."""


def describe(launch_file: str) -> LaunchDescription:
    """Return the description of `COMMAND.launch.py`: its arguments are the options of the command."""
    file = Path(launch_file)
    command = file.name.partition(".")[0]
    starting = OpaqueFunction(function=_start, args=[file, command])
    return LaunchDescription([*starmap(_declared, arguments_of(command).items()), starting])


def _declared(name: str, option: Action) -> DeclareLaunchArgument:
    default, choices = default_of(option), ["", *option.choices] if option.choices else None
    text = str(option.help) % {"default": default}
    return DeclareLaunchArgument(name, default_value=default, description=text, choices=choices)


def _start(context: LaunchContext, file: Path, command: str) -> list[ExecuteProcess]:
    """Return the command's process; LaunchArgumentError ends the launch instead."""
    # `launch` gets SIGINT by set_wakeup_fd; a KeyboardInterrupt as well would tear a callback that starts a process
    signal.signal(signal.SIGINT, lambda *_: None)
    given = dict(context.launch_configurations)
    alone = is_asked_for(file, sys.argv[1:])
    if alone:
        check_names(command, (word.partition(":=")[0] for word in context.argv))
    elif not given.get("namespace"):  # that of the group in which the other file includes this one
        given["namespace"] = given.get("ros_namespace", "")
    program = str(Path(get_package_prefix("atpid_control")) / "bin" / "atpid")

    def end(event: ProcessExited, _context: LaunchContext) -> Shutdown:
        if alone:  # there is nothing else to end; `launch` itself has no way to end with a status of one's own
            raise SystemExit(event.returncode)
        if event.returncode:
            raise _CommandEndedError(f"{command} ended with exit status {event.returncode}")
        return Shutdown(reason=f"{command} has ended")

    timeouts = {"sigterm_timeout": str(_SIGTERM_TIMEOUT), "sigkill_timeout": str(_SIGKILL_TIMEOUT)}
    words = [*_START, program, *words_of(command, given)]
    return [ExecuteProcess(cmd=words, name=command, output="screen", on_exit=end, **timeouts)]
