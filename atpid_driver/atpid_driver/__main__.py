# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_driver`."""

import sys

from atpid_driver.cli import main

if __name__ == "__main__":
    sys.exit(main())
