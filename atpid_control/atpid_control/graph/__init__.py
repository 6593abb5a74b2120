# SPDX-License-Identifier: Apache-2.0
"""The node graph from outside: its parts, their parameters and processes, and a ROS domain of its own."""
