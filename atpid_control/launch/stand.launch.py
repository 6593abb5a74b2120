# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The test stand: ros2 launch atpid_control stand.launch.py scene:=SCENE.yaml [map:=MAP.npz] [ni:=true]."""

from launch import LaunchDescription

from atpid_control.stand.launching.description import describe


def generate_launch_description() -> LaunchDescription:
    """Return the start of `atpid stand`, whose options are the arguments."""
    return describe(__file__)
