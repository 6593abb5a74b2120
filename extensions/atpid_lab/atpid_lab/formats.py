# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The file formats of this package: what its entry points of the group `atpid.formats` name.

The module that reads or writes one is imported when that is asked for: some load slowly.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from atpid_control.runs.formats import Given, Holds, Reader, Series, TableReader, Writer
from atpid_control.runs.source import Source
from atpid_control.runs.tables import Piece, Table


@dataclass(frozen=True)
class FileFormat:
    """A format (`atpid_control.runs.formats.Format`)."""

    name: str
    suffixes: tuple[str, ...]
    holds: Holds = Holds.ALL
    read: Reader | None = None
    read_table: TableReader | None = None
    write: Writer | None = None


def _reader(module: str, name: str = "read") -> Reader:
    def read(path: Path, given: Given) -> list[Series]:
        found: list[Series] = getattr(import_module(f"atpid_lab.imports.{module}"), name)(path, given)
        return found

    return read


def _writer(module: str, **options: bool) -> Writer:
    def write(source: Source, pieces: Iterable[Piece], folder: Path) -> Iterator[tuple[Table | None, Path]]:
        yield from import_module(f"atpid_lab.export.{module}").write(source, pieces, folder, **options)

    return write


def _read_csv_table(path: Path) -> tuple[Table, dict[str, Any], list[str]]:
    from atpid_lab.imports.csv_file import read_table

    return read_table(path)


CSV = FileFormat(
    "csv", (".csv",), Holds.ONE, read=_reader("csv_file"), read_table=_read_csv_table, write=_writer("csv_file")
)
TEXT = FileFormat("text", (".txt", ".tsv", ".dat", ".asc"), Holds.ONE, read=_reader("csv_file"))
UFF = FileFormat("uff", (".uff", ".unv"), Holds.SAMPLES, read=_reader("uff_file"), write=_writer("uff_file"))
UFF_ASCII = FileFormat("uff-ascii", UFF.suffixes, Holds.SAMPLES, write=_writer("uff_file", ascii=True))
MAT = FileFormat("mat", (".mat",), read=_reader("mat_file"), write=_writer("mat_file"))
PARQUET = FileFormat("parquet", (".parquet",), Holds.ONE, write=_writer("parquet_file"))
TDMS = FileFormat("tdms", (".tdms",), Holds.SAMPLES, read=_reader("waveforms", "read_tdms"), write=_writer("tdms_file"))
WAV = FileFormat("wav", (".wav",), Holds.SAMPLES, read=_reader("waveforms", "read_wav"))
