# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control figures NAME`: NAME is a module beside this one with add_arguments(parser) and run(args)."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from pathlib import Path


def names() -> list[str]:
    """Return what there are figures of."""
    return sorted(
        module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)]) if module.name != "command"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare one sub-command for each module."""
    chosen = parser.add_subparsers(metavar="NAME", required=True)
    for name in names():
        module = importlib.import_module(f"atpid_control.figures.{name}")
        figure = chosen.add_parser(name, help=(module.__doc__ or name).strip().splitlines()[0])
        module.add_arguments(figure)
        figure.set_defaults(figure=module.run)


def run(args: argparse.Namespace) -> int:
    """Make the figures; return the exit status."""
    return int(args.figure(args))
