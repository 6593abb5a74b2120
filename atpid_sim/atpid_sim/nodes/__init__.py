# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes; nothing else in this package imports rclpy."""
