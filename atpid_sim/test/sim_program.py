# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package alone, as `atpid` has them among others."""

import sys
from functools import partial

from atpid_common.cli import run_commands

_NAMES = ("map", "simulate")
main = partial(run_commands, "atpid", "", {"": {name: (f"atpid_sim.commands.{name}", name) for name in _NAMES}})
#: The same as a process of its own.
PROGRAM = [sys.executable, __file__]

if __name__ == "__main__":
    sys.exit(main())
