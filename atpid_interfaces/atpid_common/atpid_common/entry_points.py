# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What installed packages add by entry points (docs/extend.md): found by name, and loaded where it is used."""

from collections.abc import Collection
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from atpid_common.errors import AtpidError, one_line

#: Groups that two modules ask for; here, since a scene is read without loading what compiles or simulates.
SELECTORS = "atpid.selectors"  # methods of selection
CONTACT_LAWS = "atpid.contact_laws"  # the name of a law, and the module it is in


def installed(group: str, taken: Collection[str] = (), error: type[AtpidError] = AtpidError) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, sorted; nothing is imported.

    Raises `error` for a name that is `taken` by what is built in, or that another package has.
    """
    points: dict[str, EntryPoint] = {}
    for point in _laws_at_start() if group == CONTACT_LAWS else _points(group):
        if point.name in points or point.name in taken:
            other = points[point.name].value if point.name in points else "what is built in"
            raise error(f"{_named(point)}: its name is taken by {other}; rename it, or uninstall one")
        points[point.name] = point
    return points


def loaded(point: EntryPoint, needed: Collection[str] = (), error: type[AtpidError] = AtpidError) -> Any:
    """Return the object of an entry point.

    Raises `error` where it cannot be imported, whatever the reason, or has not the attributes that are `needed`.
    """
    try:
        added = point.load()
    except Exception as problem:  # the package's own code, which may fail in any way
        reason = one_line(" ".join(f"{type(problem).__name__}: {problem}".split()))
        raise error(f"{_named(point)}: cannot be loaded: {reason}; reinstall or remove its package") from problem
    if missing := [name for name in needed if not hasattr(added, name)]:
        raise error(f"{_named(point)}: lacks {', '.join(missing)}; needed: {', '.join(needed)} (docs/extend.md)")
    return added


def sources(group: str) -> list[Path]:
    """Return the files of the modules that the entry points of a group name; nothing of them is run."""
    specs = [find_spec(point.module) for point in installed(group).values()]
    return [Path(spec.origin) for spec in specs if spec is not None and spec.origin is not None]


def _points(group: str) -> list[EntryPoint]:
    return sorted(set(entry_points(group=group)), key=lambda point: (point.name, point.value))


@cache
def _laws_at_start() -> list[EntryPoint]:
    """Return the contact laws, searched for once: kernels are compiled with them, and a search takes 20 ms."""
    return _points(CONTACT_LAWS)


def _named(point: EntryPoint) -> str:
    package = f" of {point.dist.name} {point.dist.version}" if point.dist is not None else ""
    return f"{point.name} ({point.value}{package}), an entry point of the group {point.group}"
