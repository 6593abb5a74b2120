# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid ros echo TOPIC`: prints messages, as `ros2 topic echo` does where there is one."""

import argparse
import importlib
from functools import partial
from typing import Any

import yaml
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from atpid_common.arguments import graph_name, text
from atpid_common.errors import DONE, InputError
from atpid_common.interrupt import Interrupt
from atpid_common.nodes.node_main import command_node
from atpid_common.waiting import announced

TURN = 0.1  # how soon a signal is noticed [s]
#: Arguments of the example in the help.
EXAMPLE = "/excitation --field amplitude"


class Echo(Node):
    """Subscribes to one topic as soon as it is published, whatever its type."""

    def __init__(self, topic: str, field: str, once: bool) -> None:
        """Wait for a publisher of `topic`; print `field` of each message, all of it where that is empty."""
        super().__init__("echo", start_parameter_services=False)
        self._topic, self._field, self._once = self.resolve_topic_name(topic), field, once
        self.subscribed = self.done = False

    def subscribe(self) -> None:
        """Subscribe where there is a publisher now."""
        publishers = self.get_publishers_info_by_topic(self._topic)
        if not publishers or self.subscribed:
            return
        package, message = publishers[0].topic_type.split("/msg/")
        kind = getattr(importlib.import_module(f"{package}.msg"), message)
        durability, reliability = DurabilityPolicy.BEST_AVAILABLE, ReliabilityPolicy.BEST_AVAILABLE
        offered = QoSProfile(depth=10, durability=durability, reliability=reliability)
        self.create_subscription(kind, self._topic, self._on_message, offered)
        self.subscribed = True

    def _on_message(self, message: Any) -> None:
        if self.done:
            return
        try:
            for name in filter(None, self._field.split(".")):
                message = getattr(message, name)
        except AttributeError as error:
            raise InputError(f"--field: given {self._field}; {error}") from None
        print(yaml.safe_dump(plain(message), sort_keys=False).removesuffix("...\n"), "---", sep="", flush=True)
        self.done = self._once


def plain(value: Any) -> Any:
    """Return a message, or a field of one, as numbers, texts, lists and dicts."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value) if len(value) != 1 else value[0]
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        return value
    return [plain(item) for item in value]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("topic", type=graph_name, help="name of the topic")
    parser.add_argument("--field", type=text, default="", help="a field of the message, a.b for one inside another")
    parser.add_argument("--once", action="store_true", help="end after the first message")


def run(given: argparse.Namespace) -> int:
    """Print until Ctrl-C, or once; return the exit status."""
    make = partial(Echo, given.topic, given.field, given.once)
    with Interrupt() as interrupt, command_node(make) as (node, executor):
        interrupt.defer()
        with announced(f"waiting for a publisher of {given.topic}"):
            while not (node.subscribed or interrupt.received):
                executor.spin_once(timeout_sec=TURN)
                node.subscribe()
        while not (node.done or interrupt.received):
            executor.spin_once(timeout_sec=TURN)
    return DONE
