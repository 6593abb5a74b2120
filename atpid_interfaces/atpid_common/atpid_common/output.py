# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Output files and folders of the commands: what cannot be written is one line, before the work where possible."""

import argparse
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from atpid_common.errors import InputError


class OutputError(InputError):
    """A file or folder that cannot be written; one line: which, why, what to do."""


@contextmanager
def writing(target: str | os.PathLike[str], option: str = "--out") -> Iterator[None]:
    """Raise OutputError for an OSError inside: `target` cannot be written; `option` is where another is named."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error.strerror or error}; choose another {option}") from None


def folder(path: Path, option: str = "--out") -> Path:
    """Return the folder, made where it is missing; raise OutputError where no file can be made in it."""
    if path.is_file():
        raise OutputError(f"{path}: is a file; give a folder to {option}")
    with writing(path, option):
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    return path


def file(path: Path, option: str = "--out", *, replace: bool = True) -> Path:
    """Return the path of a file to write, its folder made; raise OutputError where that cannot be written.

    Checked before the work, so that a long run does not end without its result. replace: whether a file that is there
    may be replaced.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give a file to {option}")
    if not replace and os.path.lexists(path):
        raise OutputError(f"{path}: exists already; give another {option}, or --force to replace it")
    if path.exists() and not path.is_file():
        raise OutputError(f"{path}: is a pipe or a device; give a file to {option}")
    if path.parent.is_file():
        raise OutputError(f"{path}: {path.parent} is a file; choose another {option}")
    folder(path.parent, option)
    return path


def add_force(parser: argparse.ArgumentParser) -> None:
    """Declare `--force`, without which no file that is there is replaced."""
    parser.add_argument("--force", action="store_true", help="replace files that are there already")


def finite(value: Any) -> Any:
    """Return a value, and what dicts and lists in it contain, with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
