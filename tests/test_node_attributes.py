# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""No node replaces a private attribute of rclpy's own class: its timers or parameters would no longer be served."""

import ast
from pathlib import Path

import pytest
import rclpy
from rclpy.lifecycle import LifecycleNode

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
OF_RCLPY = {"Node", "LifecycleNode"}
ON_PURPOSE = {"DeviceNode": {"_LifecycleNodeMixin__on_change_state"}}


def classes() -> dict[str, ast.ClassDef]:
    """Return every class of the packages' modules, by name."""
    found = {}
    for path in sorted(ROOT.glob("atpid_*/atpid_*/**/*.py")):
        for item in ast.walk(ast.parse(path.read_text())):
            if isinstance(item, ast.ClassDef):
                found[item.name] = item
    return found


def is_node(item: ast.ClassDef, known: dict[str, ast.ClassDef]) -> bool:
    """Whether a class is derived from rclpy's node, directly or not."""
    bases = {base.id for base in item.bases if isinstance(base, ast.Name)}
    return bool(bases & OF_RCLPY) or any(is_node(known[base], known) for base in bases if base in known)


def own_names(item: ast.ClassDef) -> set[str]:
    """Return the private methods of a class and the private attributes it sets on `self`."""
    methods = {part.name for part in item.body if isinstance(part, ast.FunctionDef)}
    attributes = {
        part.attr
        for part in ast.walk(item)
        if isinstance(part, ast.Attribute)
        and isinstance(part.ctx, ast.Store)
        and isinstance(part.value, ast.Name)
        and part.value.id == "self"
    }
    return {name for name in methods | attributes if name.startswith("_") and not name.startswith("__")}


def test_no_node_replaces_what_rclpy_keeps() -> None:
    rclpy.init()
    try:
        node = LifecycleNode("attributes")
        private = {name for name in dir(node) if name.startswith("_")}
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    known = classes()
    nodes = {name: item for name, item in known.items() if is_node(item, known)}
    assert {"PlantNode", "RecorderNode", "ReplayNode", "LabJackNode", "MotorNode"} <= set(nodes)
    replaced = {name: own_names(item) & private for name, item in nodes.items()}
    assert {name: found for name, found in replaced.items() if found} == ON_PURPOSE
