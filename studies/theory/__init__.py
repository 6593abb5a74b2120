# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Closed forms, passive dampers and quantities of the thesis, which runs are compared with."""
