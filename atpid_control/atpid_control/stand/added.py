# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes of the graph that packages of their own bring: entry points of the group `atpid.nodes`, by the node's name.

The core has such a node's topics, supervises it and says when it is part of a run; its package has the executable, the
parameter file, and what a run sets in it. Entry points are read only where a run has such a node: that takes 0.1 s.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atpid_common.cli import load
from atpid_common.errors import one_line
from atpid_control.stand.errors import BenchError
from atpid_control.stand.part import Part

if TYPE_CHECKING:
    from atpid_common.nodes.parameters import Entry
    from atpid_sim.scene import Scene

#: Group of the entry points; the name of one is the name of its node, its value an `AddedPart`.
GROUP = "atpid.nodes"
#: The node that puts out an excitation that is commanded: from `excitation/command` to `excitation/state`.
EXCITER = "excitation_node"
#: The package that brings a node, by the node's name: of extensions of this project, installed or not.
_BROUGHT_BY = Path(__file__).parents[1] / "data" / "nodes.json"

Values = dict[str, Any]


@dataclass(frozen=True)
class AddedPart:
    """A node that a package adds to bench and stand, and what a run sets in it.

    table: the node's parameters, rows of `atpid_common.nodes.parameters`, as "module:name".
    simulated: returns what the simulated bench sets in it for a scene.
    emulated: returns what the emulated stand sets in it, and in feed_node, which passes its output on to the plant:
    for the scene, a folder for files, and what is set already, by `simulated` and by the user.
    """

    part: Part
    table: str
    simulated: Callable[[Scene], Values]
    emulated: Callable[[Scene, Path, Mapping[str, Any]], tuple[Values, Values]]


@cache
def added_part(name: str) -> AddedPart:
    """Return the node of this name. Raises BenchError: no installed package has it, several do, or it does not load."""
    found = {entry.value: entry for entry in entry_points(group=GROUP, name=name)}
    if len(found) != 1:
        raise BenchError(f"{name} is in several packages: {', '.join(found)}" if found else missing(name))
    (entry,) = found.values()
    try:
        part = entry.load()
    except Exception as error:  # the package's own code, which may fail in any way
        raise BenchError(f"{name} of {entry.value} cannot be loaded: {one_line(str(error))}") from error
    if not isinstance(part, AddedPart):
        raise BenchError(f"{name} of {entry.value} is a {type(part).__name__}: it must be an {AddedPart.__name__}")
    return part


def is_installed(name: str) -> bool:
    """Return whether a package has the node of this name; nothing is imported."""
    return bool(entry_points(group=GROUP, name=name))


def missing(name: str) -> str:
    """Return the line on a node that no installed package has: which package brings it."""
    brought: dict[str, str] = json.loads(_BROUGHT_BY.read_text(encoding="utf-8"))
    if name not in brought:
        return f"no installed package has {name}"
    return (
        f"{name} comes with the package {brought[name]}, which is not installed: "
        f"colcon build --packages-select {brought[name]}, or `make setup`"
    )


def table_of(name: str) -> tuple[Entry, ...]:
    """Return the parameters of a node that a package adds. Raises BenchError as `added_part` does."""
    table: tuple[Entry, ...] = load(added_part(name).table)
    return table
