# SPDX-License-Identifier: Apache-2.0
"""The test stand: ros2 launch atpid_control stand.launch.py scene:=SCENE.yaml map:=MAP.npz [ni:=true]."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def config(package: str, name: str) -> PathJoinSubstitution:
    """Return the package's parameter file `name`."""
    return PathJoinSubstitution([FindPackageShare(package), "config", name])


def text(argument: str) -> ParameterValue:
    """Return a launch argument as a text parameter, whatever it looks like."""
    return ParameterValue(LaunchConfiguration(argument), value_type=str)


def generate_launch_description() -> LaunchDescription:
    """Return the hardware nodes, identifier, selector and recorder; Ctrl-C stops the motor and closes the bag."""
    return LaunchDescription([
        DeclareLaunchArgument("scene", description="scene file: beam, grain and ceiling; absolute path"),
        DeclareLaunchArgument("map", default_value="", description="height map; empty: the one the scene names"),
        DeclareLaunchArgument("bag", default_value="", description="bag to make; empty: run-<id> in this folder"),
        DeclareLaunchArgument("ni", default_value="false", description="true: also stream the NI-9230 accelerometer"),
        DeclareLaunchArgument("labjack_config", default_value=config("atpid_driver", "labjack.yaml"),
                              description="channels and calibration of the LabJack T7"),
        DeclareLaunchArgument("ni_config", default_value=config("atpid_driver", "ni.yaml"),
                              description="channels and calibration of the NI-9230"),
        DeclareLaunchArgument("motor_config", default_value=config("atpid_driver", "motor_serial.yaml"),
                              description="serial port, limits and speed of the ceiling's motor"),
        Node(package="atpid_control", executable="recorder_node", output="screen",
             parameters=[config("atpid_control", "recorder.yaml"), {"bag": text("bag"), "scene": text("scene")}]),
        Node(package="atpid_control", executable="identifier_node", output="screen",
             parameters=[config("atpid_control", "identifier.yaml")]),
        Node(package="atpid_control", executable="selector_node", output="screen",
             parameters=[config("atpid_control", "selector.yaml"), {"scene": text("scene"), "map": text("map")}]),
        Node(package="atpid_driver", executable="motor_node", output="screen",
             parameters=[LaunchConfiguration("motor_config")]),
        Node(package="atpid_driver", executable="labjack_node", output="screen",
             parameters=[LaunchConfiguration("labjack_config")]),
        Node(package="atpid_driver", executable="ni_node", output="screen",
             condition=IfCondition(LaunchConfiguration("ni")),
             parameters=[LaunchConfiguration("ni_config")]),
    ])  # fmt: skip
