# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Universal file format, data set 58: a time record a channel, in binary (58b, doubles bit by bit) or in ASCII.

Written here, not by pyuff, which the tests read it with: pyuff turns NaN into 0, which would make lost samples look
measured, and holds a channel five times over. A record has no gaps: where samples are lost or invalid the next record
begins, with its first index in its description. Format: SDRC data sets 58 and 58b, 151 (header), 164 (units), as
https://www.ceas3.uc.edu/sdrluff/ prints them.
"""

import sys
from collections.abc import Iterable, Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import BinaryIO

import numpy as np

from atpid_control.runs.source import Source
from atpid_control.runs.tables import INDEX, STAMP, TIME, Column, Piece, Table
from atpid_lab.export.spool import Spool
from atpid_sim.system import Array

#: Nodes of what is measured, upward (+Z is 3); channels of another name come after them.
NODES = {"support": 1, "beam": 2, "grain": 3, "ceiling": 4}
_FIRST_OTHER, _UP = 11, 3
#: Specific data types of units, and their exponents of length and force.
_QUANTITIES = {"m": (8, 1, 0), "m/s": (11, 1, 0), "m/s^2": (12, 1, 0), "N": (13, 0, 1)}
_TIME_RESPONSE, _REAL_DOUBLE, _EVEN, _TIME_AXIS = 1, 4, 1, 17
_ROWS = 1 << 14
#: In ASCII: values a line, their form, and what an exponent of two digits holds at least.
_A_LINE, _FORM, _LEAST = 4, "%20.12E", 1e-99


def write(
    source: Source, pieces: Iterable[Piece], folder: Path, *, ascii: bool = False
) -> Iterator[tuple[Table | None, Path]]:
    """Write the channels of all evenly sampled tables to one file in `folder`; yield it.

    Raises OSError, BagError: there is none.
    """
    spool, path = Spool(folder), folder / "whole.uff"
    spool.fill(piece for piece in pieces if piece.table.rate is not None)
    if not spool.tables:
        raise source.no_samples("uff")
    with path.open("wb") as stream:
        date = _date(source.start_ns)
        head = source.path.name, "bag of ATPID", "atpid", f"{date}{'0':>10}{'0':>10}", date, "atpid", date
        _lines(stream, 151, *head)
        _lines(stream, 164, f"{1:10d}{'SI':>20}{2:10d}", f"{1.0:25.17E}{1.0:25.17E}{1.0:25.17E}", f"{273.15:25.17E}")
        for table in spool.tables:
            for place, column in enumerate(table.columns):
                if column in table.values:
                    _channel(stream, source, table, column, spool, place, ascii)
    yield None, path


def _channel(
    stream: BinaryIO, source: Source, table: Table, column: Column, spool: Spool, place: int, ascii: bool
) -> None:
    values = spool.column(table, place)
    names = [known.name for known in table.columns]
    time, stamps, index = (spool.column(table, names.index(name)) for name in (TIME, STAMP, INDEX))
    node = NODES.get(column.name.split("_")[0], _FIRST_OTHER + place)
    pieces, lost = list(runs(values)), table.lost
    for number, (begin, end) in enumerate(pieces, 1):
        about = (
            f"{column.name} of /{table.name}",
            f"run {source.run.get('run_id', 'unknown')}, {source.path.name}",
            _date(int(stamps[begin])),
            f"record {number} of {len(pieces)}, first index {int(index[begin])}, lost {lost} samples",
            f"rate {table.rate!r} Hz, first stamp {int(stamps[begin])} ns, skew {column.skew!r} s",
            f"{_TIME_RESPONSE:5d}{0:10d}{number:5d}{0:10d} {'NONE':<10}{node:10d}{_UP:4d} {'NONE':<10}{0:10d}{0:4d}",
        )
        steps = end - 1 - begin  # on the time base of the stamps
        step = float(time[end - 1] - time[begin]) / steps if steps else 1.0 / (table.rate or 1.0)
        _record(stream, about, column, float(time[begin]), step, values[begin:end], ascii)


def runs(values: Array) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of the parts of a series (n,) without NaN, read a piece at a time."""
    begin = None
    for first in range(0, len(values), _ROWS):
        valid = np.isfinite(values[first : first + _ROWS])
        edges = np.flatnonzero(np.diff(np.concatenate(([begin is not None], valid)).astype(np.int8)))
        for edge in edges:
            if begin is None:
                begin = first + int(edge)
            else:
                yield begin, first + int(edge)
                begin = None
    if begin is not None:
        yield begin, len(values)


def _record(
    stream: BinaryIO, about: tuple[str, ...], column: Column, start: float, step: float, values: Array, ascii: bool
) -> None:
    order = 1 if sys.byteorder == "little" else 2
    binary = f"b{order:6d}{2:6d}{11:12d}{8 * len(values):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    kind, length, force = _QUANTITIES.get(column.unit, (0, 0, 0))
    unused = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {'NONE':<20}"
    lines = (
        f"{-1:6d}",
        f"{58:6d}{'' if ascii else binary}",
        *(_text(line, 80) for line in about),
        f"{_REAL_DOUBLE:10d}{len(values):10d}{_EVEN:10d}{start:13.5e}{step:13.5e}{0.0:13.5e}",
        f"{_TIME_AXIS:10d}{0:5d}{0:5d}{0:5d} {'time':<20} {'s':<20}",
        f"{kind:10d}{length:5d}{force:5d}{0:5d} {_text(column.name, 20)} {_text(column.unit or 'NONE', 20)}",
        unused,
        unused,
    )
    stream.write("".join(f"{line}\n" for line in lines).encode("ascii"))
    for first in range(0, len(values), _ROWS):
        part = np.ascontiguousarray(values[first : first + _ROWS], np.float64)
        stream.write(digits(part) if ascii else part.data)
    stream.write(b"    -1\n")


def digits(values: Array) -> bytes:
    """Return values (n,) as lines of Fortran's 4E20.12."""
    values = np.where(np.abs(values) < _LEAST, 0.0, values)
    rows, rest = divmod(len(values), _A_LINE)
    lines = (_FORM * _A_LINE + "\n") * rows + (_FORM * rest + "\n" if rest else "")
    return (lines % tuple(values.tolist())).encode("ascii")


def _lines(stream: BinaryIO, number: int, *lines: str) -> None:
    text = [f"{-1:6d}", f"{number:6d}", *(_text(line, 80) for line in lines), f"{-1:6d}"]
    stream.write("".join(f"{line}\n" for line in text).encode("ascii"))


def _text(text: str, width: int) -> str:
    """Return a text in `width` characters of printable ASCII."""
    plain = "".join(sign if sign.isascii() and sign.isprintable() else "?" for sign in text)
    return f"{plain[:width]:<{width}}"


def _date(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc).strftime("%d-%b-%y %H:%M:%S")
