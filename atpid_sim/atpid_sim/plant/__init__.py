# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulated plant: one integration continued block by block, and what its sensors measure."""
