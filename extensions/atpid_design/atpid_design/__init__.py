# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Design of a damper for a given structure: grain, heights, motor, and the reduction to expect (docs/design.md)."""
