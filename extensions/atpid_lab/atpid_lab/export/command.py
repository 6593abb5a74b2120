# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag export BAG`: a bag as a file of another program, or several where the format holds one table a file."""

import argparse
import math
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from atpid_common import output
from atpid_common.arguments import file_path, graph_name
from atpid_control.commands.results import add_bag, add_part, print_missing
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Format, Holds, Writer, bag_of, formats
from atpid_control.runs.source import Source
from atpid_control.runs.tables import TIME, Piece, Table
from atpid_sim.display import working

_Files = list[tuple[Table | None, Path]]
#: What installs a library that set-up leaves out, by its module.
_INSTALLS = {"pyarrow": "make parquet", "nptdms": "make import"}
#: The table that gets the name given: the measured displacements where they are there.
_FIRST = "sensors/laser"
#: Rows written at once, at least, or as many pieces.
_ROWS, _PIECES = 16_384, 64


@dataclass(frozen=True)
class _Exported:
    """What was written, and what the bag does not have."""

    files: list[tuple[Path, str]]  # each with what is in it
    missing: list[str]
    left_out: list[str]  # tables that the format cannot hold


def export(
    bag: Path,
    form: str,
    out: Path,
    topics: Sequence[str] = (),
    begin: float = -math.inf,
    end: float = math.inf,
    *,
    replace: bool = False,
) -> _Exported:
    """Write the tables of a bag, from `begin` to `end` [s], to `out`; one table a file: the others beside it.

    Nothing is written where the export fails. Raises BagError, OutputError.
    """
    known, write = writers()[form]
    if out.suffix.lower() not in known.suffixes:
        raise BagError(f"--out: given {out}; allowed with --format {form}: a file that ends in {known.suffixes[0]}")
    output.file(out, replace=replace)
    beside = sorted(out.parent.glob(f"{out.stem}.*{out.suffix}")) if known.holds is Holds.ONE else []
    if beside and not replace:
        raise BagError(f"{beside[0]}: exists already; give another --out, or --force to replace it")
    source = Source(bag, topics)
    with output.writing(out), tempfile.TemporaryDirectory(prefix=".export-", dir=out.parent) as folder:
        rows = Counter[str]()
        made = _made(form, lambda: list(write(source, _gathered(_part(source, begin, end), rows), Path(folder))))
        if not rows and not any(table.rows for table in source.tables):
            raise source.empty()
        if not rows:
            raise BagError(f"{bag}: no row from {begin:g} to {end:g} s; give a part in which something was recorded")
        others = [table.name for table in source.tables if table.rate is None and table.rows]
        others = others if known.holds is Holds.SAMPLES else []
        files = _placed(made, {name: count for name, count in rows.items() if name not in others}, out)
    return _Exported(files, source.missing, others)


def writers() -> dict[str, tuple[Format, Writer]]:
    """Return the formats that can be written, by name. Raises BagError: an installed one cannot be loaded."""
    return {name: (one, one.write) for name, one in formats().items() if one.write is not None}


def _made(form: str, write: Callable[[], _Files]) -> _Files:
    """Return the files that `write` makes. Raises BagError: what it needs is not installed."""
    try:
        return write()
    except ImportError as error:
        module = (error.name or "").partition(".")[0]
        reason = f"needs {module}, which is not installed"
        how = _INSTALLS.get(module, f"pip install {module}")
        raise BagError(f"--format {form}: {reason}; `{how}` installs it, or give --format csv, mat or uff") from None


def _placed(made: _Files, rows: Mapping[str, int], out: Path) -> list[tuple[Path, str]]:
    """Give the files made their names."""
    tables = [table for table, _ in made if table is not None]
    sampled = [table for table in tables if table.rate is not None] or tables
    main = next((table for table in sampled if table.name == _FIRST), sampled[0] if sampled else None)
    found = []
    for table, path in made:
        place = out
        if table is not None and table is not main:
            place = out.with_name(f"{out.stem}.{table.name.replace('/', '_')}{out.suffix}")
        os.replace(path, place)
        names = rows if table is None else [table.name]
        found.append((place, "; ".join(f"{name}, {rows[name]} rows" for name in names)))
    return sorted(found, key=lambda one: one[0] != out)


def _gathered(pieces: Iterator[Piece], counted: Counter[str]) -> Iterator[Piece]:
    """Yield the same rows in larger pieces: writing has a cost a piece, and a block has few rows.

    `counted` gets the rows by table.
    """
    waiting: dict[str, list[Piece]] = {}
    rows: dict[str, int] = {}
    for piece in pieces:
        name = piece.table.name
        waiting.setdefault(name, []).append(piece)
        rows[name] = rows.get(name, 0) + len(piece)
        counted[name] += len(piece)
        if rows[name] >= _ROWS or len(waiting[name]) >= _PIECES:
            yield _joined(waiting.pop(name))
            rows[name] = 0
    yield from map(_joined, waiting.values())


def _joined(pieces: list[Piece]) -> Piece:
    columns = zip(*(piece.arrays for piece in pieces), strict=True)
    return Piece(pieces[0].table, tuple(np.concatenate(arrays) for arrays in columns))


def _part(source: Source, begin: float, end: float) -> Iterator[Piece]:
    """Yield the rows with times from `begin` to `end` [s]."""
    for piece in source.pieces():
        if begin == -math.inf and end == math.inf:
            yield piece
            continue
        names = [column.name for column in piece.table.columns]
        time = piece.arrays[names.index(TIME)]
        inside = (time >= begin) & (time <= end)
        if inside.any():
            yield Piece(piece.table, tuple(array[inside] for array in piece.arrays))


EXAMPLE = "bags/thesis_4_3_short --format csv --out out/run.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_bag(parser)
    add = parser.add_argument
    add("--format", choices=tuple(writers()), required=True, help="csv and parquet: a file a topic, named after --out")
    add("--out", type=file_path, required=True, metavar="FILE", help="the file to write")
    add("--topic", type=graph_name, action="append", default=[], metavar="TOPIC", help="only this topic; repeatable")
    add_part(parser)
    output.add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Export and print what was written and what is missing; return 0. Raises BagError, OutputError."""
    with working(f"exporting to {args.format}"):
        done = export(bag_of(args.bag), args.format, args.out, args.topic, args.begin, args.end, replace=args.force)
    for path, what in done.files:
        print(f"{path}: {what}")
    print_missing(done.missing)
    if done.left_out:
        print(f"not evenly sampled, so not in this format: {', '.join(done.left_out)}")
    return 0
