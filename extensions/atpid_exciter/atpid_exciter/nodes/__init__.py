# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The excitation node, and the command that drives it."""
