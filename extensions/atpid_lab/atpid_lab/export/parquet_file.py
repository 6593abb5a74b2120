# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parquet: a file a table; units and comments are metadata of the columns."""

import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

from atpid_control.runs.source import Source
from atpid_control.runs.tables import TEXT, Column, Piece, Table

#: Rows of a row group, at least.
_GROUP = 131_072


class _File:
    """One table while it is written, in row groups."""

    def __init__(self, table: Table, path: Path, stack: ExitStack) -> None:
        import pyarrow
        import pyarrow.parquet as parquet

        self._arrow = pyarrow
        self.table, self.path = table, path
        self._schema = self._arrow.schema([self._field(column) for column in table.columns])
        self._writer = stack.enter_context(parquet.ParquetWriter(path, self._schema))
        self._waiting: list[object] = []
        self._rows = 0

    def add(self, piece: Piece) -> None:
        columns = zip(piece.arrays, self._schema, strict=True)
        arrays = [self._arrow.array(values, field.type) for values, field in columns]
        self._waiting.append(self._arrow.Table.from_arrays(arrays, schema=self._schema))
        self._rows += len(piece)
        if self._rows >= _GROUP:
            self.flush()

    def flush(self) -> None:
        if self._waiting:
            self._writer.write_table(self._arrow.concat_tables(self._waiting), row_group_size=self._rows)
        self._waiting, self._rows = [], 0

    def finish(self, source: Source) -> None:
        self.flush()
        about = {**self.table.about(), "run": source.run, "start_ns": source.start_ns, "missing": source.missing}
        self._writer.add_key_value_metadata({"atpid": json.dumps(about)})

    def _field(self, column: Column) -> object:
        kind = self._arrow.string() if column.dtype == TEXT else self._arrow.from_numpy_dtype(column.dtype)
        about = {"units": column.unit, "description": column.description, "skew": repr(column.skew)}
        return self._arrow.field(column.name, kind, metadata=about)


def write(source: Source, pieces: Iterable[Piece], folder: Path) -> Iterator[tuple[Table, Path]]:
    """Write each table to a file in `folder`; yield what was made. Raises OSError, BagError."""
    files: dict[str, _File] = {}
    with ExitStack() as stack:
        for piece in pieces:
            name = piece.table.name
            if name not in files:
                files[name] = _File(piece.table, folder / f"{len(files)}.parquet", stack)
            files[name].add(piece)
        for file in files.values():
            file.finish(source)
    yield from ((file.table, file.path) for file in files.values())
