# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What this package adds by entry points: its commands (`atpid.commands`), and its checks (`atpid.checks`)."""

from atpid_common.cli import Commands

COMMANDS: Commands = {
    "Run the nodes": {
        "excite": ("atpid_exciter.nodes.excite", "command the exciter of nodes that run already, until Ctrl-C"),
    },
}
#: Of `atpid doctor`.
CHECKS = {"exciter": ("atpid_exciter.part:exciter", "docs/excitation_output.md")}
