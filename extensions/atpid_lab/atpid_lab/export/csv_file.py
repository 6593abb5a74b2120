# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""CSV: a file a table, which begins with comments (`#`) that describe it; names with units in the first other line."""

import csv
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

import pandas as pd

from atpid_common.errors import one_line
from atpid_control.runs.source import Source
from atpid_control.runs.tables import Column, Piece, Table


def write(source: Source, pieces: Iterable[Piece], folder: Path) -> Iterator[tuple[Table, Path]]:
    """Write each table to a file in `folder`; yield what was made. Raises OSError, BagError.

    Numbers have as many digits as give the same number again; texts are quoted.
    """
    with ExitStack() as stack:
        streams: dict[str, tuple[Table, Path, TextIO]] = {}
        for piece in pieces:
            table = piece.table
            if table.name not in streams:
                path = folder / f"{len(streams)}.rows"
                streams[table.name] = table, path, stack.enter_context(path.open("w", encoding="utf-8", newline=""))
            names = [column.name for column in table.columns]
            arrays = [array.astype(int) if array.dtype == bool else array for array in piece.arrays]
            frame = pd.DataFrame(dict(zip(names, arrays, strict=True)))
            stream, quoted = streams[table.name][2], csv.QUOTE_NONNUMERIC  # a text may hold the sign of a comment
            frame.to_csv(stream, header=False, index=False, lineterminator="\n", quoting=quoted)
    for number, (table, rows, _) in enumerate(streams.values()):
        path = folder / f"{number}.csv"
        # what was lost is known now only; the rows follow their description
        with path.open("w", encoding="utf-8", newline="") as whole, rows.open(encoding="utf-8", newline="") as stream:
            whole.writelines(f"# {line}\n" for line in _description(source, table))
            whole.write(",".join(map(_heading, table.columns)) + "\n")
            while text := stream.read(1 << 20):
                whole.write(text)
        rows.unlink()
        yield table, path


def _description(source: Source, table: Table) -> Iterator[str]:
    yield f"{source.path.name}, topic {table.topic}, {table.type}; SI units"
    for name in ("run_id", "created", "commit", "scene", "clock"):
        if source.run.get(name):
            yield one_line(f"{name}: {source.run[name]}")
    yield f"time 0 is the stamp {source.start_ns} ns"
    if table.rate is not None:
        yield f"rate: {table.rate!r} Hz; lost: {table.lost} samples, whose rows are there with empty cells"
        yield from (f"lost: {count} samples from index {first} on" for first, count in table.gaps)
    for column in table.columns:
        text = f"{column.name}: {column.description}" + (f"; sampled {column.skew!r} s later" if column.skew else "")
        if column.description or column.skew:
            yield one_line(text)
    yield from (one_line(f"missing: {line}") for line in source.missing)


def _heading(column: Column) -> str:
    text = f"{column.name} [{column.unit}]" if column.unit else column.name
    quoted = text.replace('"', '""')
    return f'"{quoted}"' if any(sign in text for sign in ',"#\r\n') else text  # `#` would begin a comment
