# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim`."""

import sys

from atpid_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
