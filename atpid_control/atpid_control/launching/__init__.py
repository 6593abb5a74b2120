# SPDX-License-Identifier: Apache-2.0
"""What the launch files share.

`arguments` checks with the standard library only: `ros2 launch` runs in the Python of the ROS installation, which does
not have the project's requirements. Only `description` imports `launch` and `launch_ros`.
"""
