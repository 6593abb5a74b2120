# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into identifier and selector, and records what they answer where `record` names a folder."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = (
    ("bag", None, "folder of the bag to play"),
    ("scene", None, "scene file of the run; `python -m atpid_control.recording extract BAG` writes the one in the bag"),
    ("map", "", "height map for the look-up; empty: the one the scene names"),
    ("rate", "1.0", "speed against the recording; 0.0: as fast as the loop answers"),
    ("record", "", "folder of the bag to make of the replay; empty: none"),
)


def config(name: str) -> PathJoinSubstitution:
    return PathJoinSubstitution([FindPackageShare("atpid_control"), "config", name])


def text(name: str) -> ParameterValue:
    return ParameterValue(LaunchConfiguration(name), value_type=str)


def generate_launch_description() -> LaunchDescription:
    recording = PythonExpression(["'", LaunchConfiguration("record"), "' != ''"])
    arguments = [DeclareLaunchArgument(name, default_value=value, description=said) for name, value, said in ARGUMENTS]
    stamps = {"scene": text("scene"), "lockstep": True}
    return LaunchDescription(
        [
            *arguments,
            Node(
                package="atpid_control",
                executable="identifier_node",
                parameters=[config("identifier.yaml")],
            ),
            Node(
                package="atpid_control",
                executable="selector_node",
                parameters=[config("selector.yaml"), {**stamps, "map": text("map")}],
            ),
            Node(
                package="atpid_control",
                executable="recorder_node",
                parameters=[config("recorder.yaml"), {**stamps, "bag": text("record")}],
                condition=IfCondition(recording),
            ),
            Node(
                package="atpid_control",
                executable="replay_node",
                parameters=[
                    {
                        "bag": text("bag"),
                        # no motor here: where the ceiling was comes from the bag as well
                        "topics": ["sensors/*", "ceiling/state"],
                        "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                        "expect_recorder": ParameterValue(recording, value_type=bool),
                    }
                ],
                on_exit=Shutdown(),
            ),
        ]
    )
