# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_control.recording`."""

import sys

from atpid_control.commands.recording import main

if __name__ == "__main__":
    sys.exit(main())
