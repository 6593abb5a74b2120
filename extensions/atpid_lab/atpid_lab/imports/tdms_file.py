# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""TDMS, read by npTDMS chunk by chunk: waveforms, and groups with a channel of times."""

import logging
from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.runs.formats import Given, Grid, Series
from atpid_lab.imports.series import mapped, shortest, timed

_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read(path: Path, given: Given) -> list[Series]:
    """Return the channels, which are kept in files beside: memory is that of a chunk. Raises BagError."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.CRITICAL)  # what is cut off is a note
    found: list[Series] = []
    with path.open("rb") as stream, TdmsFile.open(stream) as file:
        if file.file_status.incomplete_final_segment:
            given.notes.append(f"{path.name}: its last segment is cut off: what is missing of it is not known")
        for group in file.groups():
            columns: dict[str, tuple[str, Any]] = {}
            for channel in group.channels():
                unit = next((str(channel.properties[name]) for name in _UNITS if name in channel.properties), "")
                step = float(channel.properties.get("wf_increment", 0.0))
                if not len(channel) or channel.dtype.kind not in "fiu":
                    what = "no samples" if not len(channel) else "no numbers"
                    given.notes.append(f"{path.name}: {group.name}/{channel.name}: left out, it holds {what}")
                    continue
                # by slices npTDMS would read a whole chunk, which may be the file, for each of them
                values = mapped(path, given, (chunk[:] for chunk in channel.data_chunks()))
                if step > 0.0 and not given.rate:
                    begin = channel.properties.get("wf_start_time")
                    start_ns = 0 if begin is None else int(np.datetime64(begin, "ns").astype(np.int64))
                    start_ns += round(float(channel.properties.get("wf_start_offset", 0.0)) * 1e9)
                    grid = Grid(shortest(1.0 / step, 0.0), len(values), start_ns, begin is not None)
                    found.append(Series(f"{group.name}/{channel.name}", unit, values, grid))
                else:
                    columns[channel.name] = unit, values
            if columns:
                found += timed(path, f"{group.name}/", columns, given)
    return found
