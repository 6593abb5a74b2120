# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Supervision of a run: whether all nodes answer, whether all quantities keep to their limits, whether all is in order.

Pure rules: what happens is passed to them together with the steady time at which it happened.
"""
