# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The file formats of this package: what its entry points of the group `atpid.formats` name.

The module that reads or writes one is imported when that is asked for: some load slowly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from atpid_common.cli import load
from atpid_control.runs.formats import Holds, Reader, TableReader, Writer


@dataclass(frozen=True)
class FileFormat:
    """A format (`atpid_control.runs.formats.Format`)."""

    name: str
    suffixes: tuple[str, ...]
    holds: Holds = Holds.ALL
    read: Reader | None = None
    read_table: TableReader | None = None
    write: Writer | None = None


def _late(place: str, **options: bool) -> Callable[..., Any]:
    """Return what calls a function, "module:function" of this package, with options."""
    return lambda *given: load(f"{__package__}.{place}")(*given, **options)


_CSV, _UFF = "imports.csv_file:read", "export.uff_file:write"
CSV = FileFormat(
    "csv", (".csv",), Holds.ONE, _late(_CSV), _late("imports.csv_file:read_table"), _late("export.csv_file:write")
)
TEXT = FileFormat("text", (".txt", ".tsv", ".dat", ".asc"), Holds.ONE, read=_late(_CSV))
UFF = FileFormat("uff", (".uff", ".unv"), Holds.SAMPLES, read=_late("imports.uff_file:read"), write=_late(_UFF))
UFF_ASCII = FileFormat("uff-ascii", UFF.suffixes, Holds.SAMPLES, write=_late(_UFF, ascii=True))
MAT = FileFormat("mat", (".mat",), read=_late("imports.mat_file:read"), write=_late("export.mat_file:write"))
PARQUET = FileFormat("parquet", (".parquet",), Holds.ONE, write=_late("export.parquet_file:write"))
_TDMS = _late("imports.waveforms:read_tdms"), None, _late("export.tdms_file:write")
TDMS = FileFormat("tdms", (".tdms",), Holds.SAMPLES, *_TDMS)
WAV = FileFormat("wav", (".wav",), Holds.SAMPLES, read=_late("imports.waveforms:read_wav"))
