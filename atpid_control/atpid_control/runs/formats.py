# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""File formats of other programs: the role of a format, and the formats that installed packages bring.

This package reads bags. A format is an entry point of the group `atpid.formats`; none is loaded to read a bag.
"""

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol

from atpid_common.errors import not_installed, one_line
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import SQLITE_ENDING, bag_in, find_parts
from atpid_control.runs.source import Source
from atpid_control.runs.tables import Columns, Piece, Table, Values

#: Group of the entry points that add formats; the name of an entry point is that of its format.
GROUP = "atpid.formats"
#: Endings of a bag's files; those of the folder of a bag are any.
_OF_BAGS = ("", ".mcap", SQLITE_ENDING)
#: The package that reads files of an ending as a run: of extensions of this project, installed or not.
_BROUGHT_BY = Path(__file__).parents[1] / "data" / "formats.json"


@dataclass(frozen=True)
class Grid:
    """When samples were taken: series of the same grid were sampled together."""

    rate: float  # [Hz]
    rows: int
    start_ns: int = 0  # stamp of the first sample since 1970, else after the file's own zero [ns]
    dated: bool = False  # whether it is since 1970
    jumps: tuple[tuple[int, int], ...] = ()  # (row, index of its sample) after each gap


@dataclass(frozen=True)
class Series:
    """One channel of a file."""

    name: str  # in the file; a group or a struct it is in stands before it, with /
    unit: str  # as the file spells it; empty: not stated
    values: Values  # (n,) of numbers, taken by slices
    grid: Grid


@dataclass
class Given:
    """What a reader is given, and what it reports besides series."""

    folder: Path  # for files that are mapped
    rate: float | None = None  # [Hz]: rows count as even
    time: str = ""  # name of the column with times
    notes: list[str] = field(default_factory=list)  # what was converted, assumed or left out, a line each


class Holds(Enum):
    """What one file of a format can hold of a bag's tables."""

    ALL = "all tables"
    ONE = "one table: the others are files beside it"
    SAMPLES = "tables of samples alone"


Reader = Callable[[Path, Given], list[Series]]
TableReader = Callable[[Path], tuple[Table, Columns, list[str]]]
Writer = Callable[[Source, Iterable[Piece], Path], Iterator[tuple[Table | None, Path]]]


class Format(Protocol):
    """A kind of files, and what reads or writes it.

    For who adds one: an object with these attributes, which a package of yours declares in its setup.py as

        entry_points={"atpid.formats": ["vendor = my_package.vendor:FORMAT"]}

    Needed are `name`, `suffixes`, `holds`, and one at least of `read`, `read_table` and `write`, with None for those
    the format does not have. What they bring: `read` lets `atpid bag import` take its files, `write` is a choice of
    `atpid bag export --format`, `read_table` lets `open_run` and each command that takes a table open a file as it is.
    Those of two formats with the same ending: the first by name is taken.

    A library that loads slowly, or that is not always installed, is imported in these functions, not with the module.
    `atpid_control.runs.format_contract` has the tests that every format passes.
    """

    @property
    def name(self) -> str:
        """The name of its entry point: one word, which `--format` takes."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Endings of its files, in lower case with the dot; the first is the usual one."""

    @property
    def holds(self) -> Holds:
        """What one file of it holds; of a format that is not written nothing asks for it."""

    @property
    def read(self) -> Reader | None:
        """Return the channels of a file, as read(path, given); `given.notes` gets what was left out or assumed.

        Raises BagError for a file that is none of its kind; errors of a library count as that too.
        """

    @property
    def read_table(self) -> TableReader | None:
        """Return a file as the one table of a run, as read_table(path): evenly sampled, of the format's name as type.

        Its columns begin with TIME, STAMP and INDEX. Besides: each column's array by name, and a line for all that
        was left out. Raises BagError.
        """

    @property
    def write(self) -> Writer | None:
        """Write pieces of the tables of a bag, as write(source, pieces, folder); yield each file with its table.

        `None` stands for the table of a file that holds several. The files have any name in `folder`, which is empty
        and that of the format alone. Memory does not grow with the length of the bag. What `source` knows of
        losses is known when the pieces have ended. Raises OSError, BagError.
        """


_MEMBERS = ("name", "suffixes", "holds", "read", "read_table", "write")


def formats() -> dict[str, Format]:
    """Return the formats of all installed packages by name, loaded.

    Raises BagError naming an entry point that cannot be loaded, is no format, or has the name of another.
    """
    found: dict[str, Format] = {}
    for point in sorted(set(entry_points(group=GROUP)), key=lambda point: (point.name, point.value)):
        what = f"format {point.name} ({point.value})"
        if point.name in found:
            raise BagError(f"{what}: its name is taken; rename its entry point in the group {GROUP}, or uninstall one")
        try:
            loaded: Format = point.load()
        except Exception as error:  # the package's own code, which may fail in any way
            reason = one_line(f"{type(error).__name__}: {error}")
            raise BagError(f"{what}: cannot be loaded: {reason}; reinstall or remove its package") from error
        if missing := [name for name in _MEMBERS if not hasattr(loaded, name)]:
            raise BagError(f"{what}: lacks {', '.join(missing)}; needed: what Format has")
        if loaded.name != point.name:
            raise BagError(f"{what}: its name is {loaded.name!r}; allowed: the entry point's")
        found[point.name] = loaded
    return found


def table_reader(path: Path) -> TableReader | None:
    """Return what reads a file as a table, by its ending; None: it is a bag, or nothing that can be read.

    Raises BagError naming the package that reads such a file, where that is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in _OF_BAGS or path.is_dir():
        return None
    for known in formats().values():
        if suffix in known.suffixes and known.read_table is not None:
            return known.read_table
    brought: dict[str, str] = json.loads(_BROUGHT_BY.read_text(encoding="utf-8"))
    if suffix in brought:
        raise BagError(f"{path}: a {suffix} file is read by {not_installed(brought[suffix])}")
    return None


def bag_of(path: Path) -> Path:
    """Return the bag at `path`, or in the run there; raise BagError where there is none.

    Commands begin with it, before they make a folder for their results. A table, which some take too, is itself.
    """
    if table_reader(path) is None:
        find_parts(path := bag_in(path))
    return path
