# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Several dampers on one structure beside computations that share nothing with the engine."""
