# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid emulator --link PORT`: the emulated motor board by hand."""

import argparse
import signal
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from atpid_common.arguments import file_path, real, text
from atpid_common.errors import DONE
from atpid_common.injected_faults import LINK, FaultError, overlapping, parsed
from atpid_driver.emulator import Emulator
from atpid_driver.emulator.line import FaultyLine, InjectedFaults

#: Arguments of the example in the help.
EXAMPLE = "--link out/motor --height 0.3"


def run(arguments: argparse.Namespace) -> int:
    """Serve the board at a port in real time until interrupted; commands on standard input inject and clear faults."""
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: sys.exit(0))
    faults = parsed(arguments.fault or [], LINK, "the line to the board")
    if both := overlapping(faults):
        raise FaultError(f"--fault: given {both[0]} and {both[1]}; allowed: one at a time")
    with ExitStack() as stack:
        port = arguments.link
        if faults:  # the line stands between the port that was asked for and the board's own
            port = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="atpid-board-"))) / "board"
        emulator = stack.enter_context(
            Emulator(port, eeprom=arguments.eeprom, height=arguments.height, bootloader=1.0, reset_on_open=True)
        )
        if faults:
            stack.enter_context(FaultyLine(arguments.link, port, InjectedFaults(faults)))
        emulator.pace(1.0)
        print(f"emulated board at {arguments.link}; type a command (set jam 1, unplug, state, ...)", flush=True)
        for line in sys.stdin:
            print(emulator.command(line.strip()), flush=True)
        signal.pause()
    return DONE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--link", type=file_path, required=True, metavar="PORT", help="where its serial port appears")
    parser.add_argument("--eeprom", type=file_path, metavar="FILE", help="file that keeps the board's EEPROM")
    parser.add_argument(
        "--height", type=real(0.0, 10.0, "m"), default=0.3, metavar="H", help="where the ceiling is at first [m]"
    )
    form = "'serial_link KIND FROM TO [VALUE]'"
    fault = "a fault of the line, with times in s from the first height on (docs/faults.md); again for more"
    parser.add_argument("--fault", type=text, action="append", metavar=form, help=fault)
