# SPDX-License-Identifier: Apache-2.0
"""Entry points of the executables: each loads its module with signals handled and returns its exit status."""

from functools import partial

from atpid_common.interrupt import run_executable

foxglove_node = partial(run_executable, "atpid_control.nodes.foxglove_node")
identifier_node = partial(run_executable, "atpid_control.nodes.identifier_node")
live_node = partial(run_executable, "atpid_control.nodes.live_node")
recorder_node = partial(run_executable, "atpid_control.nodes.recorder_node")
replay_files = partial(run_executable, "atpid_control.commands.replay")
replay_node = partial(run_executable, "atpid_control.nodes.replay_node")
selector_node = partial(run_executable, "atpid_control.nodes.selector_node")
supervisor_node = partial(run_executable, "atpid_control.nodes.supervisor_node")
