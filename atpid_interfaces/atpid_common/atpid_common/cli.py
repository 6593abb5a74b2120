# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line of a program: its commands by purpose, errors in one line, exit statuses.

A command is a module, or an object in one, with `add_arguments(parser)`, `run(arguments) -> status` and `EXAMPLE`, its
arguments in one example. It is imported when the command is given: the others may need ROS, matplotlib or a compiler.
Its errors are `AtpidError`s, reported in one line.

A package of its own adds commands by an entry point of the group `atpid.commands`, whose value is a `Commands` table.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import io
import os
import re
import select
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from atpid_common.errors import BAD_INPUT, BROKEN_PIPE, INTERRUPTED, AtpidError, did_you_mean, extras, one_line

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

#: What a program can do: headings of its help, and below each the commands by name, as (module or module:object, what
#: it does). A name of two words is a command of a group, such as "bag report".
Commands = Mapping[str, Mapping[str, tuple[str, str]]]

#: The entry points by which an installed package adds its commands.
GROUP = "atpid.commands"


@dataclass(frozen=True)
class Command:
    """One of several commands in a module."""

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]
    EXAMPLE: str


def run_commands(program: str, description: str, commands: Commands, argv: Sequence[str] | None = None) -> int:
    """Run the command named by `argv`, by default the process's arguments; return its exit status."""
    given = list(sys.argv[1:] if argv is None else argv)

    def command() -> int:
        arguments = _parser(program, description, commands, [given[:1], given[:2]]).parse_args(given)
        return int(arguments.run(arguments))

    return guarded(command)


def guarded(command: Callable[[], int]) -> int:
    """Return the exit status of `command`: its own, 1 where standard output or error was closed or full before all was
    written, 2 for bad input, 3 for a numerical failure, 130 after Ctrl-C.

    An error of the project is reported in one line; any other exception is a defect and keeps its traceback.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # not open, as after `>&-`
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - open as long as the process
        elif isinstance(stream, io.TextIOWrapper):  # a file's name need not be text in the terminal's encoding
            stream.reconfigure(errors="backslashreplace")
    try:
        try:
            with extras():
                status = command()
        except KeyboardInterrupt as interrupt:
            print(interrupt if interrupt.args else "interrupted", file=sys.stderr)
            status = INTERRUPTED
        except AtpidError as error:
            print(f"error: {error}", file=sys.stderr)
            status = error.status
        except SystemExit as leaving:  # argparse has printed its help or a usage line
            status = leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
        # Anything still buffered fails here, where it can be handled, and not at the interpreter's exit.
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError as error:
        # unbuffered, nothing is kept that would fail again; files of the commands have `output.writing`
        full = error.errno == errno.ENOSPC and error.filename is None
        closed = _discard_closed()
        if not closed and not full:
            raise
        if not isinstance(error, BrokenPipeError):
            what = "standard output" if closed else "standard output or the cache of compiled kernels"
            print(f"error: {what} cannot be written: {error.strerror}", file=sys.stderr)
        return BROKEN_PIPE
    return status


def _discard_closed() -> bool:
    """Redirect standard output and error to the null device where their pipe has no reader or their disk is full;
    return whether one was so. An error elsewhere, such as of a device, is one like any other.
    """
    closed = [stream for stream in (sys.stdout, sys.stderr) if _has_no_reader(stream) or _is_full(stream)]
    for stream in closed:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
    return bool(closed)


def _has_no_reader(stream: TextIO) -> bool:
    try:
        number = stream.fileno()
    except (OSError, ValueError, AttributeError):  # replaced by a buffer, or closed
        return False
    poll = select.poll()
    poll.register(number, 0)
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _is_full(stream: TextIO) -> bool:
    """Return whether what was printed cannot be written: a flush that failed keeps it, and fails again."""
    try:
        stream.flush()
    except BrokenPipeError:
        return False
    except OSError:
        return True
    return False


#: How the help writes an argument that has no other metavar, by its name: what a command takes or makes.
_METAVARS = {"scene": "SCENE.yaml", "bag": "BAG", "recording": "BAG|FILE.csv", "map": "MAP.npz", "out": "DIR"}
_METAVARS |= {"scenes": "DIR", "node": "/NODE", "topic": "/TOPIC", "hours": "H", "margin": "M", "seconds": "S"}
_METAVARS |= dict.fromkeys(("domain", "faults", "priority", "restarts", "seed", "seeds"), "N")


class Parser(argparse.ArgumentParser):
    """A parser whose help ends with an example, whose errors are one line, as all others, with the nearest match of a
    word that is mistyped, and which fails where help or errors cannot be written: some versions of argparse drop them,
    and the status would depend on the version and on PYTHONUNBUFFERED.
    """

    def __init__(self, **settings: Any) -> None:
        """Make a parser with argparse's `settings`."""
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)
        self.inner: dict[str, str] = {}  # commands of groups, by their last word
        self._given: list[str] = []

    def add_argument(self, *names: str, **settings: Any) -> argparse.Action:
        """Declare an argument; one that many commands have is written the same way in the help of each."""
        action = super().add_argument(*names, **settings)
        if action.metavar is None and action.choices is None and action.nargs != 0:
            action.metavar = _METAVARS.get(action.dest)
        return action

    def print_help(self, file: SupportsWrite[str] | None = None) -> None:
        """Print the help."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        """Print the error in one line and end with status 2."""
        problem = one_line(message.removeprefix("argument "))
        if message.startswith("the following arguments are required"):  # what is left over is not looked at any more
            mistyped = ((word.partition("=")[0], self._nearest(word)) for word in self._given)
            problem += next((f"; given {name}{hint}" for name, hint in mistyped if hint), "")
        print(f"error: {problem}; what it takes: {self.prog} --help", file=sys.stderr)
        raise SystemExit(BAD_INPUT)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse; what is left over is an error of the command it was given to, and not of the program."""
        self._given = list(args or ())
        parsed, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f"given {' '.join(rest)}, which is no argument of it{self._nearest(rest[0])}")
        return parsed, rest

    def _nearest(self, word: str) -> str:
        """Return the hint at the option nearest to `word`; "" where it is none, or one of the command's own."""
        options, name = re.findall(r"(?<![\w-])--?[a-z][\w-]*", self.format_usage()), word.partition("=")[0]
        wrong = name.startswith("-") and not any(option.startswith(name) for option in options)
        return did_you_mean(name, options) if wrong else ""

    def _check_value(self, action: argparse.Action, value: object) -> None:
        if action.choices is not None and value not in action.choices:
            names = [str(name) for name in action.choices]
            hint = did_you_mean(str(value), names, self.inner)
            raise argparse.ArgumentError(action, f"given {value}{hint}; allowed: {', '.join(names)}")


def full_parser(program: str, commands: Commands) -> Parser:
    """Return the parser with the arguments of all commands, whose modules are loaded: for completion in a shell."""
    return _parser(program, "", commands, [name.split() for group in commands.values() for name in group])


def with_installed(commands: Commands) -> Commands:
    """Return `commands` and those of every installed package that has an entry point of `GROUP`.

    A package's command of the same name replaces none. Raises AtpidError naming a package that cannot be loaded.
    """
    from importlib import metadata  # here: it loads slowly, and a command of the core needs none of it

    from atpid_common.entry_points import loaded

    merged = {heading: dict(group) for heading, group in commands.items()}
    names = {name for group in commands.values() for name in group}
    for entry in sorted(metadata.entry_points(group=GROUP), key=lambda entry: entry.name):
        added: Commands = loaded(entry)
        for heading, group in added.items():
            new = {name: command for name, command in group.items() if name not in names}
            merged.setdefault(heading, {}).update(new)
            names |= new.keys()
    return {heading: group for heading, group in merged.items() if group}


def is_among(commands: Commands, words: Sequence[str]) -> bool:
    """Return whether the first words are a command of the table: of one word, or of a group's name and one more."""
    names = {name for group in commands.values() for name in group}
    return bool({" ".join(words[:1]), " ".join(words[:2])} & names)


def _parser(program: str, description: str, commands: Commands, given: Sequence[Sequence[str]]) -> Parser:
    """Return the parser, with the arguments of the commands `given` by their words; other modules stay unloaded."""
    parser = Parser(prog=program, description=f"{description}\n\n{_listed(commands)}".strip())
    places: dict[tuple[str, ...], argparse._SubParsersAction[Parser]] = {
        (): parser.add_subparsers(metavar="COMMAND", required=True, help=argparse.SUPPRESS if description else None)
    }
    for heading, group in commands.items():
        for name, (place, text) in group.items():
            *before, last = name.split()
            parser.inner |= {last: name} if before else {}
            if tuple(before) not in places:
                inner = places[()].add_parser(before[0], help=heading.lower(), description=f"{heading}.")
                places[tuple(before)] = inner.add_subparsers(metavar="COMMAND", required=True)
            command = places[tuple(before)].add_parser(last, help=text, description=text[0].upper() + text[1:] + ".")
            if name.split() in given:
                loaded = load(place)
                loaded.add_arguments(command)
                command.epilog = f"example:\n  {command.prog} {loaded.EXAMPLE}" if loaded.EXAMPLE else None
                command.set_defaults(run=loaded.run)
    return parser


def _listed(commands: Commands) -> str:
    """Return the commands below their headings, as the help shows them."""
    width = max(len(name) for group in commands.values() for name in group) + 2
    return "\n\n".join(
        "\n".join([f"{heading}:", *(f"  {name:{width}}{text}" for name, (_, text) in group.items())])
        for heading, group in commands.items()
    )


def load(place: str) -> Any:
    """Return the command at a place of the table, "module" or "module:object"."""
    module, _, name = place.partition(":")
    loaded = importlib.import_module(module)
    return getattr(loaded, name) if name else loaded
