# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes' executables: each loads its node with signals handled."""

from __future__ import annotations

from atpid_common.executable import run_executable


def identifier_node() -> int:
    """Run identifier_node; return its exit status."""
    return run_executable("atpid_control.nodes.identifier_node")


def recorder_node() -> int:
    """Run recorder_node; return its exit status."""
    return run_executable("atpid_control.nodes.recorder_node")


def replay_node() -> int:
    """Run replay_node; return its exit status."""
    return run_executable("atpid_control.nodes.replay_node")


def selector_node() -> int:
    """Run selector_node; return its exit status."""
    return run_executable("atpid_control.nodes.selector_node")
