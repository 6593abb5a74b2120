# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the executables: each loads its module with signals handled and returns its exit status."""

import gc
import os
from functools import partial

from atpid_common.interrupt import run_executable


def atpid() -> int:
    """Run the program `atpid`; return its exit status.

    What a command loads it keeps: to look through it for garbage takes a third of the time of a short run.
    """
    gc.set_threshold(50_000, 20, 20)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # it would read every package's entry points for some
    status = run_executable("atpid_control.cli")
    gc.freeze()  # nor does the interpreter at its end
    return status


identifier_node = partial(run_executable, "atpid_control.nodes.identifier_node")
live_node = partial(run_executable, "atpid_control.nodes.live_node")
recorder_node = partial(run_executable, "atpid_control.nodes.recorder_node")
replay_node = partial(run_executable, "atpid_control.nodes.replay_node")
selector_node = partial(run_executable, "atpid_control.nodes.selector_node")
supervisor_node = partial(run_executable, "atpid_control.nodes.supervisor_node")
