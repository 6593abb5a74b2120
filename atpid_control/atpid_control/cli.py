# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control COMMAND`: a module with add_arguments(parser) and run(args), loaded when asked for."""

from __future__ import annotations

import argparse
import importlib
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


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return 0, 2 for bad input, 3 for a numerical failure (one line each), 130 after Ctrl-C."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        args = _parser(arguments[0] if arguments else "").parse_args(arguments)
        return int(args.run(args))
    except KeyboardInterrupt as interrupt:
        print(interrupt if interrupt.args else "interrupted", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, ArithmeticError) as error:
        # ours are one line for a person; a plain ValueError is a mistake in the program and keeps its traceback
        if not type(error).__module__.startswith("atpid_"):
            raise
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, ValueError) else NUMERICAL_FAILURE


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
