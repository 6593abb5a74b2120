# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The options of the commands that run the graph, and the launch files made from them.

`ros2 launch` runs in the Python of the ROS installation, which does not have the project's requirements: the standard
library only. Only `description` imports `launch`.
"""
