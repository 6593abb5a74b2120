# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands of this package alone, as `atpid` has them among others."""

import sys
from functools import partial

from atpid_common.cli import run_commands

NAMES = ("echo", "lifecycle", "param")
main = partial(run_commands, "atpid", "", {"": {f"ros {name}": (f"atpid_common.nodes.{name}", name) for name in NAMES}})

if __name__ == "__main__":
    sys.exit(main())
