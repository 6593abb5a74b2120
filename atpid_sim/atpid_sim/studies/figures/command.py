# SPDX-License-Identifier: Apache-2.0
"""The command line of a figure's module."""

from collections.abc import Callable
from pathlib import Path

from atpid_common.arguments import file_path
from atpid_common.cli import Parser, guarded


def figure_command(description: str, draw: Callable[[Path], list[Path]], table: Callable[[], str]) -> int:
    """Draw into the folder --out, print the files and the table; return the exit status."""

    def run() -> int:
        parser = Parser(description=description)
        parser.add_argument("--out", type=file_path, default=Path("docs/figures"), help="folder the picture goes to")
        print(*draw(parser.parse_args().out), table(), sep="\n")
        return 0

    return guarded(run)
