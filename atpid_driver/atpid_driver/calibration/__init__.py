# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration as data: files, conversion, and making them from readings."""
