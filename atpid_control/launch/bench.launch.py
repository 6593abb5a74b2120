# SPDX-License-Identifier: Apache-2.0
"""The simulated bench in real time: ros2 launch atpid_control bench.launch.py scene:=SCENE.yaml map:=MAP.npz."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
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
    """Return plant, identifier, selector, motor and recorder; the launch ends with the plant's run."""
    return LaunchDescription([
        DeclareLaunchArgument("scene", description="scene file (docs/scenes.md); absolute path"),
        DeclareLaunchArgument("map", default_value="", description="height map; empty: the one the scene names"),
        DeclareLaunchArgument("bag", default_value="", description="bag to make; empty: run-<id> in this folder"),
        DeclareLaunchArgument(
            "motor_config",
            default_value=config("atpid_driver", "motor.yaml"),
            description="limits and speed of the ceiling; those of the scene must agree",
        ),
        Node(package="atpid_control", executable="recorder_node", output="screen",
             parameters=[config("atpid_control", "recorder.yaml"), {"bag": text("bag"), "scene": text("scene")}]),
        Node(package="atpid_control", executable="identifier_node", output="screen",
             parameters=[config("atpid_control", "identifier.yaml")]),
        Node(package="atpid_control", executable="selector_node", output="screen",
             parameters=[config("atpid_control", "selector.yaml"), {"scene": text("scene"), "map": text("map")}]),
        Node(package="atpid_driver", executable="motor_node", output="screen",
             parameters=[LaunchConfiguration("motor_config")]),
        Node(package="atpid_sim", executable="plant_node", output="screen", on_exit=Shutdown(),
             parameters=[config("atpid_sim", "plant.yaml"), {"scene": text("scene")}]),
    ])  # fmt: skip
