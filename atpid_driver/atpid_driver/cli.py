# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver COMMAND`. A command is a module with add_arguments(parser) and run(arguments) -> status;
what it refuses is a DriverError."""

from __future__ import annotations

import argparse
import importlib
import os
import select
import sys
from collections.abc import Sequence

from atpid_driver.errors import DriverError

COMMANDS = {
    "calibrate": ("atpid_driver.calibration.command", "make a calibration file from readings at known positions"),
    "reading": ("atpid_driver.calibration.reading", "take one reading at a known position, a row for calibrate"),
    "load": ("atpid_driver.nodes.load_command", "stream both devices at full rate through ROS 2, count what is lost"),
    "standin": ("atpid_driver.standins.command", "build the stand-in libraries, or inject a fault into one"),
}
"""Command names, the modules that are imported when they are used, and what they do."""

BAD_INPUT = 2
NOBODY_READS = 1
"""The reader of the output has left, as `head` does. Python's manual advises 1, and rich, which prints the tables of
other packages, ends with it too; a shell's 141 beside it would be a second answer to the same event."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return 0 done, 1 nobody reads the output, 2 bad input (said in one line), 130 after Ctrl-C."""
    try:
        status = _run(list(sys.argv[1:] if argv is None else argv))
        print(end="", flush=True)  # what is left: at the interpreter's exit nothing could be caught
        return status
    except BrokenPipeError:
        if not _nobody_reads():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NOBODY_READS


def _run(given: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m atpid_driver", description="The hardware of the ATPID stand.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    parsers = {name: commands.add_parser(name, help=text, description=text) for name, (_, text) in COMMANDS.items()}
    # Only the command that is used is imported: the others may need ROS, matplotlib or a compiler.
    command = given[0] if given and given[0] in COMMANDS else None
    module = importlib.import_module(COMMANDS[command][0]) if command else None
    if command and module:
        module.add_arguments(parsers[command])
    try:
        arguments = parser.parse_args(given)
        assert module is not None  # the parser has left with a usage line otherwise
        return int(module.run(arguments))
    except SystemExit:  # argparse has printed its help
        print(end="", flush=True)
        raise
    except DriverError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return 130


def _nobody_reads() -> bool:
    """Return whether the reader of standard output has left; any other broken pipe is an error like the rest."""
    poll = select.poll()
    poll.register(sys.stdout, 0)
    return bool(poll.poll(0))
