# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag once more through identifier and selector: ros2 launch atpid_control replay.launch.py bag:=BAG [out:=DIR]."""

from launch import LaunchDescription

from atpid_control.stand.launching.description import describe


def generate_launch_description() -> LaunchDescription:
    """Return the start of `atpid replay`, whose options are the arguments."""
    return describe(__file__)
