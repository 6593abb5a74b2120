# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes' executables: each loads its node with signals handled."""

from atpid_common.interrupt import run_executable


def plant_node() -> int:
    """Run plant_node; return its exit status."""
    return run_executable("atpid_sim.nodes.plant_node")
