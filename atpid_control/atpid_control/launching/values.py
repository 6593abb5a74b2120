# SPDX-License-Identifier: Apache-2.0
"""Checks of one launch argument's value. Each returns the value the nodes are given, or raises LaunchArgumentError."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path

from atpid_common.errors import InputError

#: A check: takes the text that was given, returns the text to use.
Check = Callable[[str], str]


class LaunchArgumentError(InputError):
    """A launch argument that cannot be used; the message is one line: what was given, what is allowed, what to do."""


def absolute(text: str) -> Path:
    """Return the absolute path of `text`: relative to the current folder, `~` and `~user` expanded."""
    try:
        return Path(os.path.abspath(Path(text).expanduser()))
    except RuntimeError:  # no such user
        raise LaunchArgumentError(f"given {text!r}; there is no such user, write the path without ~") from None


def existing_file(text: str) -> str:
    """Check that `text` is a file that can be read; return its absolute path."""
    path = absolute(text)
    if not os.path.exists(path):
        raise LaunchArgumentError(f"{path} does not exist; give a file")
    if not os.path.isfile(path):
        raise LaunchArgumentError(f"{path} is not a file; give a file")
    if not os.access(path, os.R_OK):
        raise LaunchArgumentError(f"{path} cannot be read; change its permissions or give another file")
    return str(path)


def existing_bag(text: str) -> str:
    """Check that `text` is a closed bag, given as its folder or its .mcap file; return its absolute path."""
    path = absolute(text)
    if not os.path.exists(path):
        raise LaunchArgumentError(f"{path} does not exist; give the folder of a bag")
    if os.path.isfile(path) and path.suffix == ".mcap":
        return existing_file(text)
    if not os.path.isdir(path):
        raise LaunchArgumentError(f"{path} is not a bag; give the folder of a bag, or its .mcap file")
    if not os.path.isfile(path / "metadata.yaml"):
        raise LaunchArgumentError(
            f"{path} has no metadata.yaml, so it is not a bag, or its recording was not closed; "
            f"python -m atpid_control.recording repair {path} closes one"
        )
    return str(path)


def new_folder(text: str) -> str:
    """Check that a folder can be made at `text`: it does not exist, and the nearest folder above it can be written."""
    path = absolute(text)
    if os.path.lexists(path):
        raise LaunchArgumentError(f"{path} exists already, and a bag is never overwritten; give another folder")
    parent = next(folder for folder in path.parents if os.path.lexists(folder))
    if not os.path.isdir(parent) or not os.access(parent, os.W_OK | os.X_OK):
        raise LaunchArgumentError(f"{path} cannot be made: {parent} is not a folder you may write to; give another one")
    return str(path)


def number(lowest: float, highest: float) -> Check:
    """Return a check for a finite number from `lowest` to `highest`."""

    def check(text: str) -> str:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not lowest <= value <= highest:
            raise LaunchArgumentError(f"given {text!r}; allowed: a number from {lowest:g} to {highest:g}")
        return repr(value)

    return check


def one_of(*choices: str) -> Check:
    """Return a check for one of `choices`."""

    def check(text: str) -> str:
        if text not in choices:
            raise LaunchArgumentError(f"given {text!r}; allowed: {' or '.join(choices)}")
        return text

    return check
