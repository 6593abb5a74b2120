# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`python -m atpid_sim`: compile the kernels, once after an installation."""

import time

from atpid_common.folders import cache_root
from atpid_sim import __version__, compile_kernels

if __name__ == "__main__":
    begun = time.monotonic()
    compile_kernels()
    print(f"atpid_sim {__version__}: kernels ready after {time.monotonic() - begun:.0f} s, kept in {cache_root()}")
