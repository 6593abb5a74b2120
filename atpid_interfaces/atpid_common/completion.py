# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_common.completion SHELL PROGRAM... --out FILE`: what ros2_ws/completion.sh completes, by shtab.

Made from the commands' own parsers, so that options and choices are those of the commands; a program is a package with
`cli.COMMANDS`, or a module with `parser()`.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Iterator, Sequence

import shtab

from atpid_common import output
from atpid_common.arguments import file_path, path_to, word
from atpid_common.cli import Parser, full_parser, run_parsed
from atpid_common.errors import DONE

#: Arguments of the example in the help.
EXAMPLE = "bash atpid_sim --out out/completion.bash"
SHELLS = ("bash", "zsh")
#: Arguments that are scenes.
_SCENES = ("scene", "scenes")


def script(shell: str, program: str) -> str:
    """Return the functions that complete `python -m PROGRAM`, for `shell`."""
    module = importlib.import_module(program)
    own = getattr(module, "parser", None)
    parser: Parser = own() if own else full_parser(program, importlib.import_module(f"{program}.cli").COMMANDS)
    parser.prog = program  # one word, as the shells' functions are named by it
    for action in _actions(parser):
        if action.dest in _SCENES:
            action.complete = shtab.glob("*.yaml", "*.yml")  # type: ignore[attr-defined]
        elif _is_path(action):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return str(shtab.complete(parser, shell=shell, root_prefix=program))


def _is_path(action: argparse.Action) -> bool:
    """Return whether the argument is a path: of the type `file_path`, or of one that `path_to` returns."""
    return action.type is file_path or getattr(action.type, "__qualname__", "").startswith(f"{path_to.__name__}.")


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of a parser and of its commands."""
    for action in parser._actions:  # argparse has no public list of them
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)
        else:
            yield action


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = Parser(prog="python -m atpid_common.completion", description=__doc__, example=EXAMPLE)
    parser.add_argument("shell", choices=SHELLS, help="whose functions to write")
    parser.add_argument("programs", type=word, nargs="+", metavar="PROGRAM", help="what follows python -m")
    parser.add_argument("--out", type=file_path, required=True, metavar="FILE", help="file to write")
    parser.set_defaults(run=_run)
    return run_parsed(lambda: parser, argv)


def _run(given: argparse.Namespace) -> int:
    text = "\n".join(script(given.shell, program) for program in given.programs)
    file = output.file(given.out)
    part = file.with_name(f"{file.name}.{os.getpid()}")  # a shell beside this one reads whole files only
    with output.writing(file):
        part.write_text(f"{text}\n", encoding="utf-8")
        os.replace(part, file)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
