# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package, as the entry point of the group `atpid.commands` gives them."""

from atpid_common.cli import Commands

COMMANDS: Commands = {
    "Simulate, choose a height, design": {
        "design": ("atpid_design.command", "design a damper for a structure: grain, heights, motor, reduction"),
    },
}
