# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package alone, as `atpid` has them among others."""

from functools import partial

from atpid_common.cli import run_commands
from atpid_dynamics.commands import COMMANDS

main = partial(run_commands, "atpid", "", COMMANDS)
