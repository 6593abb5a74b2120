# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into identifier and selector, and records their answers if `record` names a folder."""

from __future__ import annotations

from launch import LaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution
from launch_ros.parameter_descriptions import ParameterValue

from atpid_control.launching.description import config, describe, text
from atpid_control.launching.launch_files import REPLAY
from atpid_control.launching.supervision import node


def generate_launch_description() -> LaunchDescription:
    """Return identifier, selector, the recorder where one is wanted, and the replay, whose end is the run's."""
    recorded = NotEqualsSubstitution(LaunchConfiguration("record"), "")
    lockstep = {"scene": text("scene"), "lockstep": True}
    replay = {
        "bag": text("bag"),
        # no motor here: where the ceiling was comes from the bag as well
        "topics": ["sensors/*", "ceiling/state"],
        "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
        "expect_recorder": ParameterValue(recorded, value_type=bool),
    }
    return describe(
        __file__,
        REPLAY,
        node("atpid_control", "identifier_node", [config("atpid_control", "identifier.yaml"), {"lockstep": True}]),
        node(
            "atpid_control",
            "selector_node",
            [config("atpid_control", "selector.yaml"), {**lockstep, "map": text("map")}],
        ),
        node(
            "atpid_control",
            "recorder_node",
            [config("atpid_control", "recorder.yaml"), {**lockstep, "bag": text("record")}],
            condition=IfCondition(recorded),
        ),
        node("atpid_control", "replay_node", [replay], ends_run=True),
    )
