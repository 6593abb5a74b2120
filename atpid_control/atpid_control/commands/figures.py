# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control figures NAME`."""

import argparse

from atpid_control.studies import figures_frequency, figures_identification, figures_selection

#: Each has `add_arguments(parser)` and `run(arguments) -> status`.
FIGURES = {"frequency": figures_frequency, "identification": figures_identification, "selection": figures_selection}
#: Arguments of the example in the help.
EXAMPLE = "selection --out out/figures"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare one sub-command for each module."""
    chosen = parser.add_subparsers(metavar="NAME", required=True)
    for name, module in FIGURES.items():
        figure = chosen.add_parser(name, help=(module.__doc__ or name).strip().splitlines()[0])
        module.add_arguments(figure)
        figure.set_defaults(figure=module.run)


def run(args: argparse.Namespace) -> int:
    """Make the figures; return the exit status."""
    return int(args.figure(args))
