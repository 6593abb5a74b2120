# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim`."""

from __future__ import annotations

import sys

from atpid_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
