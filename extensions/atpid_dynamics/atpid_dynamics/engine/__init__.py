# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is compiled, kept in a folder of its own: it depends on the kernels of the simulation that it calls."""

from pathlib import Path

from atpid_sim.kernel import KERNEL_SOURCES, share_cache

share_cache("dynamics", Path(__file__).parent.glob("*.py"), KERNEL_SOURCES)  # before any of them is imported
