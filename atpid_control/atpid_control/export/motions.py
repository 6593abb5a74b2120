# SPDX-License-Identifier: Apache-2.0
"""The two signals of a bag that an analysis takes: by default support and beam of the first sensor that has both."""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from atpid_control.analysis.signals import Signals, fault_line
from atpid_control.export.source import ExportError, Source
from atpid_control.export.tables import TIME, Piece, Table
from atpid_sim.system import Array

#: What excites and what answers, by the channels of the laser.
INPUT, OUTPUT = "support_displacement", "beam_displacement"
#: Events, and their kind (Event.FAULT) for a device or a signal with a fault.
_EVENT, _FAULT = "atpid_interfaces/msg/Event", "fault"
#: Samples at most: some 6 GB while they are analysed.
_MOST = 40_000_000


class Recorded(NamedTuple):
    """Two signals of a bag."""

    signals: Signals
    missing: list[str]  # what is not there and should be, a line each
    faults: list[str]  # that were reported meanwhile


def signals_in(
    path: Path | str, given: str = INPUT, measured: str = OUTPUT, begin: float = -math.inf, end: float = math.inf
) -> Recorded:
    """Return the channels `given` and `measured` of a bag, sampled together, with what is missing and the faults.

    Lost samples are NaN; of streams with both channels the longest is taken. Blocks that have no sample from `begin`
    to `end` [s] are left out, so that a part of a long bag takes the memory of the part.
    A bag that breaks off gives what is there. Raises BagError, ExportError: no such channels.
    """
    source = Source(path)
    tables: list[Table] = []
    faults: list[str] = []
    series: dict[str, tuple[list[Array], list[Array]]] = {}
    starts: dict[str, float] = {}
    taken = Counter[str]()
    for piece in source.pieces():
        table = piece.table
        faults += _faults(piece, begin, end)
        if not {given, measured} <= _channels(table):
            continue
        if table.name not in series:
            tables.append(table)
            series[table.name], starts[table.name] = ([], []), float(piece.arrays[0][0])
        if piece.arrays[0][-1] < begin or piece.arrays[0][0] > end:
            continue
        if not series[table.name][0]:
            starts[table.name] = float(piece.arrays[0][0])
        names = [column.name for column in table.columns]
        for kept, name in zip(series[table.name], (given, measured), strict=True):
            kept.append(piece.arrays[names.index(name)])
        taken[table.name] += len(piece)
        if taken[table.name] > _MOST:
            raise ExportError(f"{path}: more than {_MOST} samples; choose a part with --from and --to")
    if not tables:
        listed = ", ".join(sorted(set().union(*map(_channels, source.tables)))) or "none"
        raise ExportError(f"{path}: no samples of {given} and {measured} together; channels in the bag: {listed}; "
                          "choose with --input and --output")  # fmt: skip
    table = max(tables, key=lambda one: taken[one.name])
    if not taken[table.name]:
        raise _no_part(path, table, starts[table.name], begin, end)
    others = [f"{one.name}: {one.rows} samples, another stream, not analysed" for one in tables if one is not table]
    units = {column.name: column.unit for column in table.columns}
    first, second = (np.concatenate(parts) for parts in series[table.name])
    named = (units[given], units[measured]), (given, measured)
    signals = Signals(table.rate or 1.0, first, second, *named, starts[table.name])
    return Recorded(signals, [*source.missing, *others], faults)


def _no_part(path: Path | str, table: Table, first: float, begin: float, end: float) -> ExportError:
    last = first + table.rows / (table.rate or 1.0)
    return ExportError(f"{path}: --from {begin:g} --to {end:g}: allowed: rising times from {first:g} to {last:g} s")


def _faults(piece: Piece, begin: float, end: float) -> Iterator[str]:
    """Yield the faults among events that were reported from `begin` to `end` [s]."""
    names = [column.name for column in piece.table.columns]
    if piece.table.type == _EVENT and {"kind", "source", "text"} <= set(names):
        kept = (piece.arrays[names.index(name)] for name in (TIME, "kind", "source", "text"))
        for time, kind, source, text in zip(*kept, strict=True):
            if kind == _FAULT and begin <= time <= end:
                yield fault_line(float(time), source, text)


def _channels(table: Table) -> set[str]:
    return {column.name for column in table.values} if table.rate is not None else set()
