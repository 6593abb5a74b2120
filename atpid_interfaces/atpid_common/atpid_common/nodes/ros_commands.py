# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `atpid ros ...`: what `ros2 topic echo`, `ros2 lifecycle set` and `ros2 param` do where there is one."""

import argparse
import importlib
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from atpid_common.arguments import graph_name, text, word
from atpid_common.cli import Command
from atpid_common.errors import DONE, InputError
from atpid_common.interrupt import Interrupt
from atpid_common.nodes.node_main import TURN, command_node
from atpid_common.waiting import announced

_TRANSITIONS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}
_ANSWER = 2.0  # how long a node may take to answer before it is asked again [s]
#: How long to wait for the node to be discovered, and for its answer [s].
_TIMEOUT = 10.0


class _Echo(Node):
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

    def _on_message(self, message: object) -> None:
        if self.done:
            return
        try:
            for name in filter(None, self._field.split(".")):
                message = getattr(message, name)
        except AttributeError as error:
            raise InputError(f"--field: given {self._field}; {error}") from None
        print(yaml.safe_dump(_plain(message), sort_keys=False).removesuffix("...\n"), "---", sep="", flush=True)
        self.done = self._once


def _plain(value: Any) -> Any:
    """Return a message, or a field of one, as numbers, texts, lists and dicts."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: _plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value) if len(value) != 1 else value[0]
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        return value
    return [_plain(item) for item in value]


def _add_echo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("topic", type=graph_name, help="name of the topic")
    parser.add_argument("--field", type=text, default="", help="a field of the message, a.b for one inside another")
    parser.add_argument("--once", action="store_true", help="end after the first message")


def _echo(given: argparse.Namespace) -> int:
    make = partial(_Echo, given.topic, given.field, given.once)
    with Interrupt() as interrupt, command_node(make) as (node, executor):
        interrupt.defer()
        with announced(f"waiting for a publisher of {given.topic}"):
            while not (node.subscribed or interrupt.received):
                executor.spin_once(timeout_sec=TURN)
                node.subscribe()
        while not (node.done or interrupt.received):
            executor.spin_once(timeout_sec=TURN)
    return DONE


ECHO = Command(_add_echo, _echo, "/excitation --field amplitude")


class _Lifecycle:
    """The lifecycle services of one node; every wait ends with KeyboardInterrupt after a signal."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, interrupt: Interrupt, name: str) -> None:
        self._executor, self._interrupt = executor, interrupt
        self._change = node.create_client(ChangeState, f"{name}/change_state")
        self._get = node.create_client(GetState, f"{name}/get_state")

    def state(self) -> str:
        """Return the node's state; asked again where no answer comes, since discovery may lose the first ones."""
        while True:
            answer = self._get.call_async(GetState.Request())
            if self._spin(answer.done, _ANSWER):
                return str(answer.result().current_state.label)

    def change(self, transition: str) -> bool:
        """Make a transition; return whether the node made it."""
        before, request = self.state(), ChangeState.Request(transition=Transition(id=_TRANSITIONS[transition]))
        while True:
            answer = self._change.call_async(request)
            if self._spin(answer.done, _ANSWER):
                return bool(answer.result().success)
            if self.state() != before:  # made, and the answer was lost
                return True

    def wait(self) -> None:
        """Wait for both services."""
        self._spin(lambda: self._change.service_is_ready() and self._get.service_is_ready(), math.inf)

    def _spin(self, happened: Callable[[], bool], seconds: float) -> bool:
        """Spin until something has happened, or for `seconds` [s]; return whether it has."""
        deadline = time.monotonic() + seconds
        while not happened() and time.monotonic() < deadline:
            if self._interrupt.received:
                raise KeyboardInterrupt
            self._executor.spin_once(timeout_sec=TURN)
        return happened()


def _add_lifecycle(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("node", type=graph_name, help="name of the lifecycle node, for example /motor_node")
    parser.add_argument("transition", choices=tuple(_TRANSITIONS), help="what it shall do")


def _lifecycle(given: argparse.Namespace) -> int:
    name, transition = given.node, given.transition
    caller = partial(Node, "lifecycle_caller", start_parameter_services=False)
    with Interrupt() as interrupt, command_node(caller) as (node, executor):
        interrupt.defer()
        services = _Lifecycle(node, executor, interrupt, name)
        with announced(f"waiting for the lifecycle services of {name}"):
            services.wait()
        done, state = services.change(transition), services.state()
        if not done:
            raise InputError(f"{name} did not {transition} and is {state}; its log has the reason")
        print(f"{name}: {state}", flush=True)
    return DONE


LIFECYCLE = Command(_add_lifecycle, _lifecycle, "/motor_node configure")


class _ParamError(InputError):
    """A node that is not there, or a parameter that cannot be read or set."""


class _Client:
    """The parameter services of one node."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, name: str) -> None:
        """Wait for the services of the node `name`; raise ParamError where they are not there."""
        self._executor, self._name = executor, name
        self._client = AsyncParameterClient(node, name)
        if not self._client.wait_for_services(_TIMEOUT):
            raise _ParamError(f"node {name}: not found within {_TIMEOUT:g} s; is it running, in this ROS_DOMAIN_ID?")

    def call(self, request: Callable[[AsyncParameterClient], Any]) -> Any:
        """Return the response to `request`; raise ParamError where none comes."""
        answer = request(self._client)
        self._executor.spin_until_future_complete(answer, _TIMEOUT)
        if not answer.done():
            raise _ParamError(f"node {self._name}: no answer within {_TIMEOUT:g} s")
        return answer.result()


def get(client: _Client, name: str) -> None:
    """Print the value of a parameter."""
    (value,) = client.call(lambda services: services.get_parameters([name])).values or (None,)
    if value is None or value.type == RosParameter.Type.NOT_SET.value:
        raise _ParamError(f"parameter {name}: the node has none of this name")
    print(parameter_value_to_python(value))


def change(client: _Client, name: str, text: str) -> None:
    """Set a parameter to the value that `text` is in YAML; raise ParamError with the node's reason where it refuses."""
    parameter = RosParameter(name, value=parameter_value_to_python(get_parameter_value(text)))
    (result,) = client.call(lambda services: services.set_parameters([parameter])).results
    if not result.successful:
        raise _ParamError(f"refused: {result.reason}")
    print(f"{name}: {parameter.value}")


def describe(client: _Client, name: str) -> None:
    """Print description and range of a parameter."""
    found: Sequence[ParameterDescriptor] = client.call(
        lambda services: services.describe_parameters([name])
    ).descriptors
    if not found or not found[0].type:
        raise _ParamError(f"parameter {name}: the node has none of this name")
    for allowed in (*found[0].floating_point_range, *found[0].integer_range):
        print(f"allowed: {allowed.from_value:g} to {allowed.to_value:g}")
    for line in filter(None, (found[0].description, found[0].additional_constraints)):
        print(line)
    print("read once, at the start" if found[0].read_only else "may be set while the node runs")


def _list_all(client: _Client) -> None:
    """Print the names of all parameters."""
    print("\n".join(sorted(client.call(lambda services: services.list_parameters([], 10)).result.names)))


_VERBS: dict[str, tuple[Callable[..., None], tuple[str, ...], str]] = {
    "get": (get, ("name",), "print a parameter's value"),
    "set": (change, ("name", "value"), "set a parameter"),
    "describe": (describe, ("name",), "print what a parameter means and which values are allowed"),
    "list": (_list_all, (), "print the names of all parameters"),
}


def _add_param(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb, (act, arguments, what) in _VERBS.items():
        command = verbs.add_parser(verb, help=what)
        command.add_argument("node", type=graph_name, help="name of the node, for example /selector_node")
        for argument in arguments:
            command.add_argument(argument, type=word)
        command.set_defaults(act=act, arguments=arguments)


def _param(given: argparse.Namespace) -> int:
    with command_node(partial(Node, "param", start_parameter_services=False)) as (node, executor):
        client = _Client(node, executor, given.node)
        given.act(client, *(getattr(given, argument) for argument in given.arguments))
    return DONE


PARAM = Command(_add_param, _param, "set /selector_node dead_band 0.02")
