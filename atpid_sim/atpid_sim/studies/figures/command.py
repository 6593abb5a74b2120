# SPDX-License-Identifier: Apache-2.0
"""The command line of a figure's module."""

import argparse
from collections.abc import Callable
from pathlib import Path

from atpid_common.cli import guarded


def figure_command(description: str, draw: Callable[[Path], list[Path]], table: Callable[[], str]) -> int:
    """Draw into the folder --out, print the files and the table; return the exit status."""

    def run() -> int:
        parser = argparse.ArgumentParser(description=description)
        parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder the picture goes to")
        print(*draw(parser.parse_args().out), table(), sep="\n")
        return 0

    return guarded(run)
