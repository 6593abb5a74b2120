# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every node of the driver with invalid parameters: it starts, or one line names what is wrong."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from atpid_common.errors import AtpidError
from atpid_driver.acquisition.registry import BUILT_IN
from atpid_driver.nodes import feed_node, motor_interface
from atpid_driver.nodes.acquisition_node import AcquisitionNode
from atpid_driver.nodes.acquisition_parameters import common_rows, own_rows
from atpid_driver.nodes.feed_node import FeedNode
from atpid_driver.nodes.labjack_node import LabJackNode
from atpid_driver.nodes.motor_node import MotorNode
from atpid_driver.nodes.ni_node import NiNode

CONFIG = Path(__file__).parents[1] / "config"
BACKENDS = [row for made in BUILT_IN.values() for row in own_rows(made.settings)]
ACQUISITION = sorted({row.name for row in (*common_rows(), *BACKENDS)})
MOTOR = [row.name for row in motor_interface.TABLE]
LONG = (1 << 63) - 1

texts = st.one_of(
    st.sampled_from(["", ".", "/", "/dev/zero", "/nowhere/x", "..", "laser_beam.yaml", "serial", "x" * 5000, "a\nb"]),
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20),
)
numbers = st.one_of(st.floats(), st.sampled_from([0.0, -1.0, 1e-300, 1e308, 0.5, 20.0, 1000.0]))
integers = st.one_of(st.integers(-LONG - 1, LONG), st.sampled_from([0, 1, -1, 250_000]))
lists = st.one_of(*(st.lists(each, max_size=4) for each in (texts, numbers, integers)))
values = st.one_of(st.booleans(), integers, numbers, texts, lists)


def shipped(name: str) -> dict[str, Any]:
    (node,) = yaml.safe_load((CONFIG / name).read_text()).values()
    return dict(node["ros__parameters"]) | {"autostart": False}


NODES: dict[str, tuple[type[Node], dict[str, Any], Sequence[str]]] = {
    "acquisition_node": (AcquisitionNode, shipped("labjack.yaml") | {"backend": "simulated"}, ACQUISITION),
    "labjack_node": (LabJackNode, shipped("labjack.yaml"), ACQUISITION),
    "ni_node": (NiNode, shipped("ni.yaml"), ACQUISITION),
    "feed_node": (FeedNode, {"feed": "FEED"}, [row.name for row in feed_node.PARAMETERS]),
    "motor_node": (MotorNode, shipped("motor.yaml"), MOTOR),
    "motor_node, serial": (MotorNode, shipped("motor_serial.yaml"), MOTOR),
}


@pytest.fixture(scope="module")
def context() -> Iterator[Context]:
    made = Context()
    rclpy.init(context=made)
    yield made
    rclpy.shutdown(context=made)


@pytest.mark.parametrize("name", NODES)
def test_a_node_starts_or_names_what_is_wrong_in_one_line(name: str, context: Context, tmp_path: Path) -> None:
    kind, usual, parameters = NODES[name]
    folder = tmp_path / "feed"
    folder.mkdir()
    refused: list[tuple[int, str]] = []

    @settings(max_examples=20, suppress_health_check=list(HealthCheck))
    @given(st.dictionaries(st.sampled_from(parameters), values, min_size=1, max_size=3))
    @example({"calibrations": ["/dev/zero", "/dev/zero"]})
    @example({"channels": [], "terminals": [], "calibrations": []})
    @example({"feed": "/proc/x"})
    @example({"topic": "a b"})
    @example({"topic": ""})
    @example({"topic": "~x/{y}"})
    def check(changes: dict[str, Any]) -> None:
        if not changes.keys() & set(parameters):
            return  # an example of another node
        given = usual | changes
        if str(given.get("feed")) not in ("", "/", ".", "..", "/proc/x"):
            given["feed"] = str(folder / "feed")
        overrides = [Parameter(key, value=value) for key, value in given.items() if key in parameters]
        try:
            node = kind(parameter_overrides=overrides, context=context)
        except AtpidError as error:
            refused.append((error.status, str(error)))
        else:
            node.destroy_node()

    check()
    assert len(refused) > 5
    assert {status for status, _ in refused} == {2}
    assert all(text for _, text in refused)
    assert list(folder.iterdir()) == []
