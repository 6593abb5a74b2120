# SPDX-License-Identifier: Apache-2.0
"""Entry points of the executables: each loads its module with signals handled."""

from __future__ import annotations

from atpid_common.executable import run_executable


def identifier_node() -> int:
    """Run identifier_node; return its exit status."""
    return run_executable("atpid_control.nodes.identifier_node")


def recorder_node() -> int:
    """Run recorder_node; return its exit status."""
    return run_executable("atpid_control.nodes.recorder_node")


def replay_files() -> int:
    """Write what a replay is started with; return the exit status."""
    return run_executable("atpid_control.commands.replay_files")


def replay_node() -> int:
    """Run replay_node; return its exit status."""
    return run_executable("atpid_control.nodes.replay_node")


def selector_node() -> int:
    """Run selector_node; return its exit status."""
    return run_executable("atpid_control.nodes.selector_node")
