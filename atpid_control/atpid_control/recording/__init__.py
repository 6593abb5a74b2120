# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From messages to a bag that `ros2 bag` reads, without rosbag2."""
