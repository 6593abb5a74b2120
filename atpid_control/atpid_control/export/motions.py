# SPDX-License-Identifier: Apache-2.0
"""The two signals of a bag that an analysis takes: by default support and beam of the first sensor that has both."""

import math
from collections import Counter
from pathlib import Path

import numpy as np

from atpid_control.analysis.signals import Signals
from atpid_control.export.source import ExportError, Source
from atpid_control.export.tables import Table
from atpid_sim.system import Array

#: What excites and what answers, by the channels of the laser.
INPUT, OUTPUT = "support_displacement", "beam_displacement"
#: Samples at most: some 6 GB while they are analysed.
_MOST = 40_000_000


def signals_in(
    path: Path | str, given: str = INPUT, measured: str = OUTPUT, begin: float = -math.inf, end: float = math.inf
) -> tuple[Signals, list[str]]:
    """Return the channels `given` and `measured` of a bag, sampled together, and what is missing, a line each.

    Lost samples are NaN; of streams with both channels the longest is taken. Blocks that have no sample from `begin`
    to `end` [s] are left out, so that a part of a long bag takes the memory of the part.
    A bag that breaks off gives what is there. Raises BagError, ExportError: no such channels.
    """
    source = Source(path)
    tables: list[Table] = []
    series: dict[str, tuple[list[Array], list[Array]]] = {}
    starts: dict[str, float] = {}
    taken = Counter[str]()
    for piece in source.pieces():
        table = piece.table
        if not {given, measured} <= _channels(table):
            continue
        if table not in tables:
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
        last = starts[table.name] + table.rows / (table.rate or 1.0)
        raise ExportError(
            f"{path}: --from {begin:g} --to {end:g}: allowed: rising times from {starts[table.name]:g} to {last:g} s"
        )
    others = [f"{one.name}: {one.rows} samples, another stream, not analysed" for one in tables if one is not table]
    units = {column.name: column.unit for column in table.columns}
    first, second = (np.concatenate(parts) for parts in series[table.name])
    named = (units[given], units[measured]), (given, measured)
    return Signals(table.rate or 1.0, first, second, *named, starts[table.name]), [*source.missing, *others]


def _channels(table: Table) -> set[str]:
    return {column.name for column in table.values} if table.rate is not None else set()
