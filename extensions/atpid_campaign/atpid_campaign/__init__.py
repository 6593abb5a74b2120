# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A stand measured over many points, its checks before a run, and its first measurement."""
