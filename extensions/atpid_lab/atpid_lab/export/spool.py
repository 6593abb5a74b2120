# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Columns of numbers kept on disk while a bag is read, for formats that take whole columns."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from atpid_control.runs.tables import TEXT, Piece, Table, Values


class Spool:
    """The tables of a bag, each column of numbers in a file of `folder`; texts stay in memory."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.tables: list[Table] = []
        self._texts: dict[tuple[str, str], list[object]] = {}

    def fill(self, pieces: Iterable[Piece]) -> None:
        """Take all pieces. Raises OSError where the disk is full."""
        for piece in pieces:
            if piece.table not in self.tables:
                self.tables.append(piece.table)
            for place, (column, array) in enumerate(zip(piece.table.columns, piece.arrays, strict=True)):
                if column.dtype == TEXT:
                    self._texts.setdefault((piece.table.name, column.name), []).extend(array)
                else:
                    with self._file(piece.table, place).open("ab") as stream:
                        stream.write(np.ascontiguousarray(array, column.dtype).data)

    def column(self, table: Table, place: int) -> Values:
        """Return a column (n,), mapped from its file."""
        column = table.columns[place]
        if column.dtype == TEXT:
            texts = np.empty(len(self._texts[table.name, column.name]), dtype=object)
            texts[:] = self._texts[table.name, column.name]
            return texts
        return np.memmap(self._file(table, place), column.dtype, "r")

    def _file(self, table: Table, place: int) -> Path:
        return self._folder / f"{self.tables.index(table)}.{place}"
