# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into identifier and selector, with the bag's own parameters; `record` names a bag of their answers."""

from launch import LaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution

from atpid_control.launching.arguments import REPLAY
from atpid_control.launching.description import GraphNode, ReplayParameters, describe


def generate_launch_description() -> LaunchDescription:
    """Return identifier, selector, the recorder where one is wanted, and the replay, whose end is the run's."""
    parameters = ReplayParameters()
    recorded = NotEqualsSubstitution(LaunchConfiguration("record"), "")
    return describe(
        __file__,
        REPLAY,
        GraphNode("atpid_control", "identifier_node", parameters),
        GraphNode("atpid_control", "selector_node", parameters),
        GraphNode("atpid_control", "recorder_node", parameters, condition=IfCondition(recorded), ends_last=True),
        GraphNode("atpid_control", "replay_node", parameters, ends_run=True),
    )
