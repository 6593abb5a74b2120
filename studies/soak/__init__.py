# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The soak: the bench for hours with a random schedule, its memory, handles, segments, delay and losses over time."""
