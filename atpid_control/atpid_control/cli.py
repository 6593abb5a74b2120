# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control COMMAND`: a module with add_arguments(parser) and run(args), loaded when asked for."""

from __future__ import annotations

import argparse
import importlib
import os
import select
import sys
from collections.abc import Sequence

#: Command: (module, what it does).
COMMANDS = {
    "bench": ("atpid_control.bench.command", "run a scene through the whole node graph: bag, summary and report"),
    "seeds": ("atpid_control.bench.seeds", "run scenes through the loop with many noises, without the node graph"),
    "report": ("atpid_control.report.command", "make the report of a bag: an HTML page and pictures"),
    "select": ("atpid_control.select_command", "select the ceiling height for a scene's excitation"),
    "calibrate-beam": (
        "atpid_control.beam_calibration.command",
        "find a beam's stiffness, damping and mass from a recording",
    ),
    "figures": ("atpid_control.figures.command", "make the figures of the documentation"),
}
DONE, BAD_INPUT, NUMERICAL_FAILURE, INTERRUPTED = 0, 2, 3, 130
#: The reader of the output has left, as `head` does. Python's manual advises 1, and rich, which prints the tables, ends
#: with it too; a shell's 141 beside it would be a second answer to the same event.
NOBODY_READS = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return 0, 1 where nobody reads the output, 2 for bad input, 3 for a numerical failure, 130
    after Ctrl-C; 2 and 3 in one line each.
    """
    try:
        status = _run(list(sys.argv[1:] if argv is None else argv))
        print(end="", flush=True)  # what is left: at the interpreter's exit nothing could be caught
        return status
    except BrokenPipeError:
        if not _nobody_reads():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NOBODY_READS


def _run(arguments: list[str]) -> int:
    try:
        args = _parser(arguments[0] if arguments else "").parse_args(arguments)
        return int(args.run(args))
    except SystemExit:  # argparse has printed its help
        print(end="", flush=True)
        raise
    except KeyboardInterrupt as interrupt:
        print(interrupt if interrupt.args else "interrupted", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, ArithmeticError) as error:
        # ours are one line for a person; a plain ValueError is a mistake in the program and keeps its traceback
        if not type(error).__module__.startswith("atpid_"):
            raise
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, ValueError) else NUMERICAL_FAILURE


def _nobody_reads() -> bool:
    """Return whether the reader of standard output has left; any other broken pipe is an error like the rest."""
    poll = select.poll()
    poll.register(sys.stdout, 0)
    return bool(poll.poll(0))


def _parser(wanted: str) -> argparse.ArgumentParser:
    """Return the parser, with the arguments of the command that is wanted; the others' modules stay unloaded."""
    parser = argparse.ArgumentParser(
        prog="python -m atpid_control", description="Control of the tuned particle impact damper."
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, (module_name, text) in COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        if name == wanted:
            module = importlib.import_module(module_name)
            module.add_arguments(command)
            command.set_defaults(run=module.run)
    return parser
