# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package, as the entry point of the group `atpid.commands` gives them."""

from atpid_common.cli import Commands

COMMANDS: Commands = {
    "Simulate, choose a height, design": {
        "sweep": (
            "atpid_dynamics.commands.sweep",
            "the steady motions over many heights, support amplitudes and grain masses",
        ),
        "basin": (
            "atpid_dynamics.commands.basin",
            "the share of kicks or initial states that come to the steady motion",
        ),
        "cliffs": (
            "atpid_dynamics.commands.cliffs",
            "follow a periodic motion over the height, and the cliff where it ends",
        ),
    },
}
