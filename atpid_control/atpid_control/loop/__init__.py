# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The control loop without ROS: when to select a height, the command for each estimate, and monitoring of the beam."""
