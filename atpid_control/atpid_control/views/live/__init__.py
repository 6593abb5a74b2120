# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page: what a run shows while it goes on (docs/live.md). Free of ROS; nodes/live_node.py feeds it."""
