# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recording against its simulation: the scene driven by the measured support, compared period by period."""
