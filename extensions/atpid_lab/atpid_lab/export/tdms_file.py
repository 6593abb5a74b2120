# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""TDMS of National Instruments, by npTDMS: a group a stream of samples, a waveform a channel, lost samples NaN."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from atpid_control.runs.source import Source
from atpid_control.runs.tables import STAMP, TIME, Piece, Table

#: TDMS's own times are written to this [ns]; the rest is the offset of the waveform.
_TICK = 1000


def write(source: Source, pieces: Iterable[Piece], folder: Path) -> Iterator[tuple[Table | None, Path]]:
    """Write the channels of all evenly sampled tables to one file in `folder`; yield it. Raises OSError, BagError."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    path, spans = folder / "whole.tdms", dict[str, tuple[Table, int, int, int]]()
    with TdmsWriter(path) as writer:
        for piece in pieces:
            table = piece.table
            if table.rate is None:
                continue
            columns = dict(zip(table.columns, piece.arrays, strict=True))
            writer.write_segment([ChannelObject(table.name, column.name, columns[column]) for column in table.values])
            stamps = next(array for column, array in columns.items() if column.name == STAMP)
            _, first, _, rows = spans.get(table.name, (table, int(stamps[0]), 0, 0))
            spans[table.name] = table, first, int(stamps[-1]), rows + len(piece)
        if not spans:
            raise source.no_samples("tdms")
        about = {**source.run, "bag": str(source.path), "missing": "; ".join(source.missing)}
        writer.write_segment([RootObject(about)])
        for table, first, last, rows in spans.values():
            step = (last - first) / (rows - 1) * 1e-9 if rows > 1 else 1.0 / (table.rate or 1.0)
            known = {"wf_start_time": np.datetime64(first // _TICK, "us"), "wf_start_offset": first % _TICK * 1e-9}
            known |= {"wf_increment": step, "wf_xname": TIME, "wf_xunit_string": "s"}
            channels = []
            for column in table.values:
                own = {"unit_string": column.unit, "description": column.description, "skew": column.skew}
                channels.append(ChannelObject(table.name, column.name, None, known | own))
            of_group = {"topic": table.topic, "type": table.type, "lost": table.lost, "first_stamp": first}
            writer.write_segment([GroupObject(table.name, of_group), *channels])
    yield None, path
