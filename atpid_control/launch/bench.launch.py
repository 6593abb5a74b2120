# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bench in real time: ros2 launch atpid_control bench.launch.py scene:=SCENE.yaml [out:=DIR]."""

from launch import LaunchDescription

from atpid_control.stand.launching.description import describe


def generate_launch_description() -> LaunchDescription:
    """Return the start of `atpid bench`, whose options are the arguments."""
    return describe(__file__)
