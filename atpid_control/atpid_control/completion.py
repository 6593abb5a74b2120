# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid completion SHELL --out FILE`: what ros2_ws/completion.sh completes, by shtab.

Made from the commands' own parsers, so that options and choices are those of the commands.
"""

import argparse
import os
from collections.abc import Iterator

import shtab

from atpid_common import output
from atpid_common.arguments import file_path, path_to
from atpid_common.cli import full_parser
from atpid_common.errors import DONE
from atpid_control.cli import commands

EXAMPLE = "bash --out out/completion.bash"
SHELLS = ("bash", "zsh")
#: Arguments that are scenes.
_SCENES = ("scene", "scenes")
#: Begins the name of a type that `path_to` returns: of a path with a certain ending.
_PATH_TO = f"{path_to.__name__}."


def script(shell: str) -> str:
    """Return the functions that complete `atpid`, for `shell`."""
    parser = full_parser("atpid", commands())
    for action in _actions(parser):
        if action.dest in _SCENES:
            action.complete = shtab.glob("*.yaml", "*.yml")  # type: ignore[attr-defined]
        elif action.type is file_path or getattr(action.type, "__qualname__", "").startswith(_PATH_TO):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return str(shtab.complete(parser, shell=shell, root_prefix="atpid"))


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its commands."""
    for action in parser._actions:  # argparse has no public list of them
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
        else:
            yield action


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("shell", choices=SHELLS, help="whose functions to write")
    parser.add_argument("--out", type=file_path, required=True, metavar="FILE", help="file to write")


def run(given: argparse.Namespace) -> int:
    """Write the functions; return 0."""
    file = output.file(given.out)
    part = file.with_name(f"{file.name}.{os.getpid()}")  # a shell beside this one reads whole files only
    with output.writing(file):
        part.write_text(f"{script(given.shell)}\n", encoding="utf-8")
        os.replace(part, file)
    return DONE
