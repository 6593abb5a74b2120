# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages that cannot be used: each node goes on and counts them. No node replaces an attribute of rclpy's own."""

from __future__ import annotations

import array
import ast
import math
import re
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from atpid_interfaces import msg
from graph_runs import parameters
from hypothesis import settings
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message

from atpid_common.message_checks import CHECKS, check
from atpid_common.nodes.checked import Dropped
from atpid_control.nodes.identifier_node import IdentifierNode
from atpid_control.nodes.recorder_node import RecorderNode
from atpid_control.nodes.selector_node import SelectorNode
from atpid_control.nodes.supervisor_node import SupervisorNode
from atpid_driver.nodes.motor_node import MotorNode
from atpid_lab.nodes.foxglove_node import FoxgloveNode
from atpid_sim.nodes.plant_node import PlantNode

NODES = {"identifier_node": IdentifierNode, "selector_node": SelectorNode, "recorder_node": RecorderNode,
         "motor_node": MotorNode, "plant_node": PlantNode, "supervisor_node": SupervisorNode,
         "foxglove_node": FoxgloveNode}  # fmt: skip
NUMBERS = [0.0, -1.0, 1.0, 0.3, 1e-300, 1e9, 1e308, -1e308, math.nan, math.inf, -math.inf, 5.49, 0.015, 1000.0]
TEXTS = ["", "x", "support_displacement", "beam_displacement", "finished", "started", "labjack:1", "\u00b5" * 50]
#: Messages to each node: as many as `make fuzz` gives, or few.
COUNT = 100_000 if settings.get_current_profile_name() == "long" else 1_000
RANGES = {"uint8": 8, "uint32": 32, "uint64": 64}


def value(kind: str, rng: np.random.Generator) -> Any:
    """A value of a field, by chance ordinary or at an extreme."""
    if kind.startswith("sequence<"):
        length = int(rng.choice([0, 1, 2, 2, 3, 50, 100, 101, 200]))
        return [value(kind[9:-1], rng) for _ in range(length)]
    if kind == "double":
        return float(rng.choice(NUMBERS))
    if kind == "boolean":
        return bool(rng.random() < 0.1)
    if kind == "string":
        return str(rng.choice(TEXTS))
    bits = RANGES[kind]
    extremes = [0, 1, 2, 3, 5, 7, 50, 1000, 2**31, 2**62, 2 ** (bits - 1), 2**bits - 1]
    return extremes[rng.integers(len(extremes))] % 2**bits


def hostile(kind: type[Any], rng: np.random.Generator) -> Any:
    """A message of a type with values of its own kind but of no sense."""
    message = kind()
    for name, field in kind.get_fields_and_field_types().items():
        if name == "header":
            message.header.stamp.sec = int(rng.choice([0, 1, 100, 1_700_000_000, -1, -(2**31), 2**31 - 1]))
            message.header.stamp.nanosec = int(rng.choice([0, 50_000_000, 999_999_999, 2**32 - 1]))
            message.header.frame_id = str(rng.choice(TEXTS))
        else:
            setattr(message, name, value(field, rng))
    return message


@pytest.fixture(params=sorted(NODES))
def node(request: pytest.FixtureRequest, scenes: Path, tmp_path: Path) -> Iterator[Node]:
    """One node with the parameters of the bench in real time."""
    context = rclpy.Context()
    context.init()
    _, given = parameters(scenes / "thesis_4_3.yaml", tmp_path, lockstep=False)
    given["foxglove_node"] = {"port": 0, "scene": str(scenes / "thesis_4_3.yaml")}
    overrides = [Parameter(name, value=value) for name, value in given[request.param].items()]
    made: Any = NODES[request.param](parameter_overrides=overrides, context=context)
    yield made
    getattr(made, "close", lambda: None)()
    made.destroy_node()
    context.shutdown()


def test_a_node_outlives_what_cannot_be(node: Node) -> None:
    rng = np.random.default_rng(7)
    subscriptions = [each for each in node.subscriptions if each.msg_type.__name__ in CHECKS]
    assert subscriptions
    refused = 0
    for _ in range(COUNT):
        chosen = subscriptions[rng.integers(len(subscriptions))]
        message = hostile(chosen.msg_type, rng)
        refused += bool(check(message))
        given: list[Any] = [serialize_message(message) if chosen.raw else message]
        if len(signature(chosen.callback).parameters) == 2:
            given.append({"received_timestamp": 1_700_000_000_000_000_000})
        chosen.callback(*given)
    assert node.context.ok()
    counted = Dropped.of(node).by_topic.total()
    if node.get_name() == "recorder_node":
        assert 0 < counted <= refused
    elif node.get_name() == "foxglove_node":  # a delay without a place in time as well
        assert counted >= refused
    else:
        assert counted == refused


#: The checks look at fields alone, so they have the last value of each enumeration once more.
LAST: list[tuple[str, str, int]] = [
    ("Excitation", "quality", msg.Excitation.POOR),
    ("Excitation", "origin", msg.Excitation.BEAM),
    ("CeilingState", "mode", msg.CeilingState.FAULT),
    ("Event", "severity", msg.Event.ALARM),
]
BLOCK: dict[str, Any] = {"rate": 1000.0, "channels": ["a", "b"], "units": ["m", "m"], "skew": [0.0, 0.0]}


def block(*values: float, **changes: Any) -> msg.SampleBlock:
    return msg.SampleBlock(**BLOCK | changes, data=array.array("d", values))


@pytest.mark.parametrize(
    ("message", "named"),
    [
        (block(*[0.0] * 101), "101 2 channels"),
        (block(0.0, 0.0, rate=math.nan), "rate nan Hz"),
        (block(0.0, 0.0, rate=0.0), "rate 0.0 Hz"),
        (block(0.0, 0.0, channels=["a", "a"]), "channels twice"),
        (block(0.0, 0.0, first_index=2**63), "index 2^62"),
        (block(0.0, math.inf), "1e+100"),
        (block(), "no samples"),
        (msg.PlantTruth(rate=1000.0, support=array.array("d", [0.0])), "0 1 values"),
        (msg.PlantTruth(rate=1000.0, input_energy=math.nan), "no number"),
        (msg.RecorderStatus(topics=["a"], received=[1], written=[]), "1 topics 0 counts"),
        (msg.Excitation(quality=msg.Excitation.STEADY, amplitude=math.nan, frequency=5.0), "amplitude nan"),
        *((getattr(msg, kind)(**{field: last + 1}), f"{field} {last + 1}") for kind, field, last in LAST),
    ],
)
def test_what_cannot_be_has_a_reason(message: Any, named: str) -> None:
    assert set(named.split()) <= set(re.findall(r"[\w.^+]+", check(message)))


@pytest.mark.parametrize("kind", CHECKS)
def test_a_stamp_before_1970_is_no_stamp(kind: str) -> None:
    message = getattr(msg, kind)()
    message.header.stamp.sec = -1
    assert "1970" in check(message)


@pytest.mark.parametrize(
    "message",
    [
        block(0.0, math.nan),
        msg.SampleBlock(handshake=True, channels=["a"]),
        msg.PlantTruth(handshake=True, ceiling=array.array("d", [0.3])),
        msg.Excitation(quality=msg.Excitation.NONE, amplitude=math.nan),
        msg.CeilingCommand(height=math.nan),
        msg.CeilingState(mode=msg.CeilingState.UNCONFIGURED, height=math.nan),
        *(getattr(msg, kind)(**{field: last}) for kind, field, last in LAST),
    ],
)
def test_what_nodes_publish_passes(message: Any) -> None:
    assert check(message) == ""


#: What a node replaces on purpose.
REPLACED = {"DeviceNode": {"_LifecycleNodeMixin__on_change_state"}}


def own_names(item: ast.ClassDef) -> set[str]:
    """Return the private methods of a class and the private attributes it sets on `self`."""
    methods = {part.name for part in item.body if isinstance(part, ast.FunctionDef)}
    stored = (part for part in ast.walk(item) if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store))
    attributes = {part.attr for part in stored if ast.unparse(part.value) == "self"}
    return {name for name in methods | attributes if name.startswith("_") and not name.startswith("__")}


def test_no_node_replaces_what_rclpy_keeps(root: Path) -> None:
    """Its timers or parameters would no longer be served."""
    context = rclpy.Context()
    context.init()
    kept = LifecycleNode("attributes", context=context)
    private = {name for name in dir(kept) if name.startswith("_")}
    kept.destroy_node()
    context.shutdown()
    places = ("atpid_*/atpid_*/**/*.py", "extensions/*/atpid_*/**/*.py")
    modules = (ast.parse(path.read_text()) for place in places for path in root.glob(place))
    known = {item.name: item for module in modules for item in ast.walk(module) if isinstance(item, ast.ClassDef)}

    def is_node(name: str) -> bool:
        bases = [base.id for base in known[name].bases if isinstance(base, ast.Name)] if name in known else []
        return name in ("Node", "LifecycleNode") or any(map(is_node, bases))

    nodes = {name: item for name, item in known.items() if is_node(name)}
    assert {"PlantNode", "RecorderNode", "ReplayNode", "LabJackNode", "MotorNode", "ExcitationNode"} <= set(nodes)
    replaced = {name: own_names(item) & private for name, item in nodes.items()}
    assert {name: found for name, found in replaced.items() if found} == REPLACED
