# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameter `scene` of a node."""

from rclpy.node import Node

from atpid_sim.scene import Scene, SceneError, load_scene


def scene_given(node: Node) -> Scene:
    """Return the scene the node's parameter `scene` names. Raises SceneError."""
    path = str(node.get_parameter("scene").value)
    if not path:
        raise SceneError(f"parameter scene of {node.get_name()} is not set: give a scene file, -p scene:=SCENE.yaml")
    return load_scene(path)
