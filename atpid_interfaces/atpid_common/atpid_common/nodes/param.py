# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid ros param get|set|describe|list NODE ...`: as `ros2 param` does where there is one."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from atpid_common.arguments import graph_name, word
from atpid_common.errors import DONE, InputError
from atpid_common.nodes.node_main import command_node

#: How long to wait for the node to be discovered, and for its answer [s].
TIMEOUT = 10.0


class ParamError(InputError):
    """A node that is not there, or a parameter that cannot be read or set."""


class Client:
    """The parameter services of one node."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor, name: str) -> None:
        """Wait for the services of the node `name`; raise ParamError where they are not there."""
        self._executor, self._name = executor, name
        self._client = AsyncParameterClient(node, name)
        if not self._client.wait_for_services(TIMEOUT):
            raise ParamError(f"node {name}: not found within {TIMEOUT:g} s; is it running, in this ROS_DOMAIN_ID?")

    def call(self, request: Callable[[AsyncParameterClient], Any]) -> Any:
        """Return the response to `request`; raise ParamError where none comes."""
        answer = request(self._client)
        self._executor.spin_until_future_complete(answer, TIMEOUT)
        if not answer.done():
            raise ParamError(f"node {self._name}: no answer within {TIMEOUT:g} s")
        return answer.result()


def get(client: Client, name: str) -> None:
    """Print the value of a parameter."""
    (value,) = client.call(lambda services: services.get_parameters([name])).values or (None,)
    if value is None or value.type == RosParameter.Type.NOT_SET.value:
        raise ParamError(f"parameter {name}: the node has none of this name")
    print(parameter_value_to_python(value))


def change(client: Client, name: str, text: str) -> None:
    """Set a parameter to the value that `text` is in YAML; raise ParamError with the node's reason where it refuses."""
    parameter = RosParameter(name, value=parameter_value_to_python(get_parameter_value(text)))
    (result,) = client.call(lambda services: services.set_parameters([parameter])).results
    if not result.successful:
        raise ParamError(f"refused: {result.reason}")
    print(f"{name}: {parameter.value}")


def describe(client: Client, name: str) -> None:
    """Print description and range of a parameter."""
    found: Sequence[ParameterDescriptor] = client.call(
        lambda services: services.describe_parameters([name])
    ).descriptors
    if not found or not found[0].type:
        raise ParamError(f"parameter {name}: the node has none of this name")
    for allowed in (*found[0].floating_point_range, *found[0].integer_range):
        print(f"allowed: {allowed.from_value:g} to {allowed.to_value:g}")
    for line in filter(None, (found[0].description, found[0].additional_constraints)):
        print(line)
    print("read once, at the start" if found[0].read_only else "may be set while the node runs")


def list_all(client: Client) -> None:
    """Print the names of all parameters."""
    print("\n".join(sorted(client.call(lambda services: services.list_parameters([], 10)).result.names)))


VERBS: dict[str, tuple[Callable[..., None], tuple[str, ...], str]] = {
    "get": (get, ("name",), "print a parameter's value"),
    "set": (change, ("name", "value"), "set a parameter"),
    "describe": (describe, ("name",), "print what a parameter means and which values are allowed"),
    "list": (list_all, (), "print the names of all parameters"),
}

#: Arguments of the example in the help.
EXAMPLE = "set /selector_node dead_band 0.02"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs and their arguments."""
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for verb, (act, arguments, text) in VERBS.items():
        command = verbs.add_parser(verb, help=text)
        command.add_argument("node", type=graph_name, help="name of the node, for example /selector_node")
        for argument in arguments:
            command.add_argument(argument, type=word)
        command.set_defaults(act=act, arguments=arguments)


def run(given: argparse.Namespace) -> int:
    """Do what the verb is for; return 0."""
    with command_node(partial(Node, "param", start_parameter_services=False)) as (node, executor):
        client = Client(node, executor, given.node)
        given.act(client, *(getattr(given, argument) for argument in given.arguments))
    return DONE
