# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of waveforms: TDMS, read by npTDMS chunk by chunk, also groups with a channel of times; and WAV.

Integers of WAV are scaled to a full scale of 1; what that is in SI is stated with --channels.
"""

import io
import logging
import warnings
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Grid, Series
from atpid_lab.imports.series import PIECE, Columns, mapped, shortest, timed

_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def read_tdms(path: Path, given: Given) -> list[Series]:
    """Return the channels, which are kept in files beside: memory is that of a chunk. Raises BagError."""
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    log_manager.set_level(logging.CRITICAL)  # what is cut off is a note
    found: list[Series] = []
    with path.open("rb") as stream, TdmsFile.open(stream) as file:
        if file.file_status.incomplete_final_segment:
            given.notes.append(f"{path.name}: its last segment is cut off: what is missing of it is not known")
        for group in file.groups():
            columns: Columns = {}
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


def read_wav(path: Path, given: Given) -> list[Series]:
    """Return the channels, mapped from the file where its numbers allow it: not with 24 bits. Raises BagError."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", wavfile.WavFileWarning)
        warnings.filterwarnings("ignore", "Chunk .non-data. not understood", wavfile.WavFileWarning)
        try:
            rate, data = wavfile.read(path, mmap=True)
        except ValueError as error:
            if "mmap=True" not in str(error):
                raise
            rate, data = wavfile.read(io.BytesIO(path.read_bytes()))  # of a file it takes the memory that is stated
    if not rate > 0 or not data.size:
        raise BagError(f"{path}: {data.size} samples at {rate} Hz; give a file with a rate and samples")
    table = data[:, None] if data.ndim == 1 else data
    rows, count = table.shape
    if table.dtype.kind in "iu":
        given.notes.append(f"{path.name}: integers ({table.dtype}) are scaled: full scale is 1")
        zero, full = (128, 128) if table.dtype == np.uint8 else (0, -int(np.iinfo(table.dtype).min))
        parts = (table[begin : begin + PIECE] for begin in range(0, rows, PIECE))
        table = mapped(path, given, ((part - np.float64(zero)) / full for part in parts)).reshape(rows, count)
    return [Series(f"channel_{n}", "", values, Grid(float(rate), rows)) for n, values in enumerate(table.T, 1)]
