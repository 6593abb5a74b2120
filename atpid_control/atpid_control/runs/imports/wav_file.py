# SPDX-License-Identifier: Apache-2.0
"""WAV: integers are scaled to a full scale of 1; what that is in SI is stated with --channels."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import wavfile

from atpid_control.runs.errors import BagError
from atpid_control.runs.imports.series import Given, Grid, Series


class _Scaled:
    """One channel of integers as numbers from -1 to 1, piece by piece."""

    def __init__(self, values: Any) -> None:
        self._values = values
        self._zero, self._full = (128, 128) if values.dtype == np.uint8 else (0, -int(np.iinfo(values.dtype).min))

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, part: slice) -> Any:
        return (self._values[part].astype(np.float64) - self._zero) / self._full


def read(path: Path, given: Given) -> list[Series]:
    """Return the channels, mapped from the file where its numbers allow it: not with 24 bits. Raises BagError."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", wavfile.WavFileWarning)
        warnings.filterwarnings("ignore", "Chunk .non-data. not understood", wavfile.WavFileWarning)
        try:
            rate, data = wavfile.read(path, mmap=True)
        except ValueError as error:
            if "mmap" not in str(error):
                raise
            rate, data = wavfile.read(path)
    if not rate > 0 or not data.size:
        raise BagError(f"{path}: {data.size} samples at {rate} Hz; give a file with a rate and samples")
    table = data[:, None] if data.ndim == 1 else data
    whole = table.dtype.kind in "iu"
    if whole:
        given.notes.append(f"{path.name}: integers ({table.dtype}) are scaled: full scale is 1")
    grid = Grid(float(rate), len(table))
    columns = (table[:, place] for place in range(table.shape[1]))
    return [Series(f"channel_{n}", "", _Scaled(one) if whole else one, grid) for n, one in enumerate(columns, 1)]
