# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes' executables: each loads its node with signals handled, and returns its exit status."""

from functools import partial

from atpid_common.interrupt import run_executable

acquisition_node = partial(run_executable, "atpid_driver.nodes.acquisition_node")
feed_node = partial(run_executable, "atpid_driver.nodes.feed_node")
labjack_node = partial(run_executable, "atpid_driver.nodes.labjack_node")
motor_node = partial(run_executable, "atpid_driver.nodes.motor_node")
ni_node = partial(run_executable, "atpid_driver.nodes.ni_node")
