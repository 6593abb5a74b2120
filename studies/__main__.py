# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m studies NAME …`."""

import sys

from studies.cli import main

if __name__ == "__main__":
    sys.exit(main())
