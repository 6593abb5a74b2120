# SPDX-License-Identifier: Apache-2.0
"""The test stand: ros2 launch atpid_control stand.launch.py scene:=SCENE.yaml map:=MAP.npz [ni:=true].

Ctrl-C ends the run: the motor is switched off and the bag closed.
"""

from launch import LaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration

from atpid_control.launching.arguments import STAND
from atpid_control.launching.description import GraphNode, config, describe, live_page, text, texts


def generate_launch_description() -> LaunchDescription:
    """Return the hardware nodes, identifier, selector and recorder."""
    files = texts("map", "labjack_config", "ni_config", "motor_config")
    recorder = {"bag": text("bag"), "scene": text("scene"), "files": files}
    selector = {"scene": text("scene"), "map": text("map")}
    with_ni = IfCondition(LaunchConfiguration("ni"))
    return describe(
        __file__,
        STAND,
        GraphNode("atpid_control", "recorder_node", config("atpid_control", "recorder.yaml"), recorder, ends_last=True),
        GraphNode("atpid_control", "identifier_node", config("atpid_control", "identifier.yaml")),
        GraphNode("atpid_control", "selector_node", config("atpid_control", "selector.yaml"), selector),
        GraphNode("atpid_driver", "motor_node", LaunchConfiguration("motor_config"), {"supervised": True}),
        GraphNode(
            "atpid_control", "supervisor_node", config("atpid_control", "supervisor.yaml"), {"scene": text("scene")}
        ),
        GraphNode("atpid_driver", "labjack_node", LaunchConfiguration("labjack_config")),
        GraphNode("atpid_driver", "ni_node", LaunchConfiguration("ni_config"), condition=with_ni),
        live_page(),
    )
