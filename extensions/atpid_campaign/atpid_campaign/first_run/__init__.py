# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stand's first measurement, step by step, beside what is expected (docs/first_run.md)."""
