# SPDX-License-Identifier: Apache-2.0
"""The commands of `python -m atpid_driver COMMAND`."""

from functools import partial

from atpid_common.cli import run_commands

#: Command: (module, what it does).
COMMANDS = {
    "calibrate": ("atpid_driver.calibration.command", "make a calibration file from readings at known positions"),
    "reading": ("atpid_driver.calibration.reading", "take one reading at a known position, a row for calibrate"),
    "load": ("atpid_driver.nodes.load_command", "stream both devices at full rate through ROS 2, count what is lost"),
    "standin": ("atpid_driver.standins.command", "build the stand-in libraries, or inject a fault into one"),
}

#: Runs one command, by default that of the process's arguments; returns its exit status (`run_commands`).
main = partial(run_commands, "atpid_driver", "The hardware of the ATPID stand.", COMMANDS)
