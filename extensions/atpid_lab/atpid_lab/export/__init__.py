# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags as files for other programs: CSV, UFF 58, MATLAB, Parquet and TDMS (docs/recording.md)."""
