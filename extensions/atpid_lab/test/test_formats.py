# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The formats of this package keep the contract of all formats."""

from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from atpid_control.runs.format_contract import FormatContract
from atpid_control.runs.formats import GROUP, Format, formats
from atpid_lab import formats as own

#: What a format needs that set-up leaves out, and what installs it.
NEEDS = {"parquet": ("pyarrow", "pyarrow is missing: `make parquet` installs it"),
         "tdms": ("nptdms", "npTDMS or h5py is missing: `make import` installs it")}  # fmt: skip


@pytest.mark.parametrize("name", sorted({entry.name for entry in entry_points(group=GROUP)}))
class TestFormats(FormatContract):
    @pytest.fixture(autouse=True)
    def chosen(self, name: str) -> None:
        if name in NEEDS:
            pytest.importorskip(NEEDS[name][0], reason=NEEDS[name][1])
        self.format = formats()[name]

    def make(self) -> Format:
        return self.format

    def example(self, folder: Path) -> Path:
        path = folder / f"example{self.format.suffixes[0]}"
        if self.format is own.TEXT:
            path.write_text("time\tbeam\n" + "".join(f"{0.01 * row:.2f}\t{row}\n" for row in range(50)))
        elif self.format is own.WAV:
            wavfile.write(path, 500, np.arange(100, dtype=np.int16))
        else:
            return super().example(folder)
        return path
