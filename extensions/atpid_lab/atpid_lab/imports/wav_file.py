# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""WAV: integers are scaled to a full scale of 1; what that is in SI is stated with --channels."""

import io
import warnings
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Grid, Series
from atpid_lab.imports.series import PIECE, mapped


def read(path: Path, given: Given) -> list[Series]:
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
