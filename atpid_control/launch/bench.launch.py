# SPDX-License-Identifier: Apache-2.0
"""The simulated bench in real time: ros2 launch atpid_control bench.launch.py scene:=SCENE.yaml [map:=MAP.npz].

The launch ends with the plant's run.
"""

from launch import LaunchDescription
from launch.substitutions import LaunchConfiguration

from atpid_control.launching.arguments import BENCH
from atpid_control.launching.description import GraphNode, config, describe, live_page, text, texts


def generate_launch_description() -> LaunchDescription:
    """Return plant, identifier, selector, motor and recorder."""
    recorder = {"bag": text("bag"), "scene": text("scene"), "files": texts("map", "motor_config")}
    selector = {"scene": text("scene"), "map": text("map")}
    return describe(
        __file__,
        BENCH,
        GraphNode("atpid_control", "recorder_node", config("atpid_control", "recorder.yaml"), recorder, ends_last=True),
        GraphNode("atpid_control", "identifier_node", config("atpid_control", "identifier.yaml")),
        GraphNode("atpid_control", "selector_node", config("atpid_control", "selector.yaml"), selector),
        GraphNode("atpid_driver", "motor_node", LaunchConfiguration("motor_config"), {"supervised": True}),
        GraphNode(
            "atpid_control", "supervisor_node", config("atpid_control", "supervisor.yaml"), {"scene": text("scene")}
        ),
        GraphNode(
            "atpid_sim", "plant_node", config("atpid_sim", "plant.yaml"), {"scene": text("scene")}, ends_run=True
        ),
        live_page(),
    )
