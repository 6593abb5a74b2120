# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control`."""

import sys

from atpid_control.cli import main

if __name__ == "__main__":
    sys.exit(main())
