# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The fault matrix: each fault of each part through the real graph, what it does and how it is detected."""
