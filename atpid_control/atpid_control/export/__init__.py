# SPDX-License-Identifier: Apache-2.0
"""Bags as tables for other programs: xarray, pandas, CSV, UFF 58, MATLAB and Parquet (docs/reading.md)."""

from atpid_control.export.labelled import frames, open_bag
from atpid_control.export.source import ExportError, Source

__all__ = ["ExportError", "Source", "frames", "open_bag"]
