# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes' executables: each loads its node with signals handled, and returns its exit status."""

from functools import partial

from atpid_common.interrupt import run_executable

excitation_node = partial(run_executable, "atpid_exciter.nodes.excitation_node")
