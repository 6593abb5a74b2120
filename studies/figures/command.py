# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies figures NAME`: the pictures of README and docs."""

import argparse
import importlib

from atpid_common.arguments import file_path

#: Each has `draw(folder) -> paths` and `table() -> str`, which is printed.
WITH_TABLE = ("contact", "free_decay", "mechanism", "speed", "stand")
#: Each has `add_arguments(parser)` and `run(arguments) -> status`.
OTHERS = ("frequency", "identification", "selection")
#: Arguments of the example in the help.
EXAMPLE = "selection --out out/figures"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare one sub-command for each picture."""
    chosen = parser.add_subparsers(metavar="NAME", required=True)
    for name in sorted((*WITH_TABLE, *OTHERS)):
        module = importlib.import_module(f"studies.figures.{name}")
        figure = chosen.add_parser(name, help=(module.__doc__ or name).strip().splitlines()[0])
        if name in OTHERS:
            module.add_arguments(figure)
            figure.set_defaults(figure=module.run)
        else:
            figure.add_argument("--out", type=file_path, required=True, metavar="DIR", help="folder for the picture")
            figure.set_defaults(figure=_with_table, module=module)
    chosen.add_parser("scenes", help="print the keys of docs/scenes.md").set_defaults(figure=_scene_tables)


def run(args: argparse.Namespace) -> int:
    """Make the figures; return the exit status."""
    return int(args.figure(args))


def _with_table(args: argparse.Namespace) -> int:
    print(*args.module.draw(args.out), args.module.table(), sep="\n")
    return 0


def _scene_tables(_: argparse.Namespace) -> int:
    from studies.figures.scenes import key_lists

    print(key_lists())
    return 0
