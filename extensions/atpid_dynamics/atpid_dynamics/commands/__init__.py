# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package, as the entry point of the group `atpid.commands` gives them."""

from atpid_common.cli import Commands

_HERE = "atpid_dynamics.commands"
COMMANDS: Commands = {
    "Simulate, choose a height, design": {
        "sweep": (f"{_HERE}.sweep", "the steady motions over many heights, support amplitudes and grain masses"),
        "basin": (f"{_HERE}.basin", "the share of kicks or initial states that come to the steady motion"),
        "cliffs": (f"{_HERE}.cliffs", "follow a periodic motion over the height, and the cliff where it ends"),
    },
}
