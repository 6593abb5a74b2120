# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the executables: each loads its module with signals handled and returns its exit status."""

from functools import partial

from atpid_common.interrupt import run_executable

foxglove_node = partial(run_executable, "atpid_lab.nodes.foxglove_node")
