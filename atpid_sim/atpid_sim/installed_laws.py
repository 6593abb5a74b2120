# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact laws of installed packages: their names and files, without loading them."""

from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

#: Group of the entry points that add a law: its name, and the module it is in.
GROUP = "atpid.contact_laws"


@cache
def installed() -> dict[str, str]:
    """Return the module of each installed law by the law's name."""
    return {entry.name: entry.value for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def sources() -> list[Path]:
    """Return the files of the installed laws: compiled code depends on them."""
    found = [find_spec(module) for module in installed().values()]
    return [Path(spec.origin) for spec in found if spec is not None and spec.origin is not None]
