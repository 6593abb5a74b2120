# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the ROS 2 nodes of all packages share; the only modules of `atpid_common` that import `rclpy`."""
