# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver COMMAND`. A command is a module with add_arguments(parser) and run(arguments) -> status;
what it refuses is a DriverError."""

from __future__ import annotations

import argparse
import importlib
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return 0 done, 2 bad input (said in one line)."""
    given = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(prog="python -m atpid_driver", description="The hardware of the ATPID stand.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    parsers = {name: commands.add_parser(name, help=text, description=text) for name, (_, text) in COMMANDS.items()}
    # Only the command that is used is imported: the others may need ROS, matplotlib or a compiler.
    command = given[0] if given and given[0] in COMMANDS else None
    module = importlib.import_module(COMMANDS[command][0]) if command else None
    if command and module:
        module.add_arguments(parsers[command])
    arguments = parser.parse_args(given)
    assert module is not None  # the parser has left with a usage line otherwise
    try:
        return int(module.run(arguments))
    except DriverError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return 130
