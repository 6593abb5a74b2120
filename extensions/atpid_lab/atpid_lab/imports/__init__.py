# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measurements made elsewhere as bags: TDMS, UFF 58, MATLAB, CSV and WAV (docs/recording.md)."""
