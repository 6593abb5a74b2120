# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid ros param`: what `ros2 param` does, where there is no `ros2`."""

import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
import rclpy
import ros_program
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from atpid_common.nodes.parameters import Entry, LiveParameters

pytestmark = pytest.mark.slow

TABLE = (
    Entry("dead_band", 0.01, "relative change that moves nothing", "-", 0.0, 0.9, live=True),
    Entry("method", "lookup", "method of selection", choices=("lookup", "pca")),
)


class Stand:
    """A node with parameters, spun while the command runs in a process of its own."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node("tested", context=self.context)
        self.parameters = LiveParameters(self.node, TABLE)
        self.parameters.follow(lambda value: value("dead_band"), lambda _: None, lambda *_: None)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def run(self, *arguments: str) -> tuple[int, str, str]:
        command = [sys.executable, ros_program.__file__, "ros", "param", *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + 100.0
        while process.poll() is None:
            assert time.monotonic() < end, "the command does not end"
            self.executor.spin_once(timeout_sec=0.02)
        out, error = process.communicate()
        return process.returncode, out.strip(), error.strip()

    def close(self) -> None:
        self.node.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def stand() -> Iterator[Stand]:
    made = Stand()
    yield made
    made.close()


def test_a_parameter_is_read_set_and_described(stand: Stand) -> None:
    assert stand.run("get", "/tested", "dead_band") == (0, "0.01", "")
    assert stand.run("set", "/tested", "dead_band", "0.02") == (0, "dead_band: 0.02", "")
    assert stand.parameters["dead_band"] == 0.02
    status, described, _ = stand.run("describe", "/tested", "dead_band")
    assert status == 0
    assert described.splitlines() == [
        "allowed: 0 to 0.9", "relative change that moves nothing [-]", "may be set while the node runs",
    ]  # fmt: skip
    assert "dead_band\nmethod" in stand.run("list", "/tested")[1]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("set", "/tested", "dead_band", "-1.0"), "error: refused: Parameter dead_band out of range"),
        (("set", "/tested", "dead_band", "3"), "error: refused: Wrong parameter type"),
        (("set", "/tested", "method", "pca"), "error: refused: Trying to set a read-only parameter: method."),
        (("get", "/tested", "nothing"), "error: parameter nothing: the node has none of this name"),
        (("describe", "/tested", "nothing"), "error: parameter nothing: the node has none of this name"),
    ],
)
def test_what_cannot_be_is_one_line_and_status_2(stand: Stand, arguments: tuple[str, ...], text: str) -> None:
    status, out, error = stand.run(*arguments)
    assert (status, out) == (2, "")
    assert error.startswith(text)
    assert "\n" not in error
