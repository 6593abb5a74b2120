# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes' executables: each loads its node with signals handled."""

from __future__ import annotations

from atpid_common.executable import run_executable


def acquisition_node() -> int:
    """Run acquisition_node; return its exit status."""
    return run_executable("atpid_driver.nodes.acquisition_node")


def feed_node() -> int:
    """Run feed_node; return its exit status."""
    return run_executable("atpid_driver.nodes.feed_node")


def labjack_node() -> int:
    """Run labjack_node; return its exit status."""
    return run_executable("atpid_driver.nodes.labjack_node")


def motor_node() -> int:
    """Run motor_node; return its exit status."""
    return run_executable("atpid_driver.nodes.motor_node")


def ni_node() -> int:
    """Run ni_node; return its exit status."""
    return run_executable("atpid_driver.nodes.ni_node")
