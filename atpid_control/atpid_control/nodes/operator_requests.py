# SPDX-License-Identifier: Apache-2.0
"""Does what the live page asks for, by the services and topics that anybody at the stand may use."""

from collections.abc import Callable, Sequence
from typing import Any

from atpid_interfaces.msg import Event
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_control.live.requests import Hold, Method, Note, Request

Answer = Callable[[tuple[bool, str]], None]
#: Services (std_srvs/Trigger) of each request: a stop is latched in the supervisor and reaches the motor at once.
TRIGGERED = {
    "stop": ("motor_node/stop", "supervisor_node/stop"),
    "disarm": ("motor_node/stop",),
    "arm": ("supervisor_node/rearm",),
}
SELECTOR = "selector_node"


class OperatorRequests:
    """Calls the services; `do` may be called from any thread, the answers come while the node spins."""

    def __init__(self, node: Node, events: EventPublisher) -> None:
        """Make the clients."""
        self._node, self._events = node, events
        names = sorted({name for group in TRIGGERED.values() for name in group})
        self._triggers = {name: node.create_client(Trigger, name) for name in names}
        self._set = node.create_client(SetParameters, f"{SELECTOR}/set_parameters")

    def do(self, request: Request, answer: Answer) -> None:
        """Do a request; `answer` is called once, with success and one line."""
        if isinstance(request, Note):
            self._events.publish(Event.INFO, Event.NOTE, request.text)
            answer((True, f"noted: {request.text}"))
        elif isinstance(request, Hold):
            self._set_parameter("hold", request.on, answer)
        elif isinstance(request, Method):
            self._set_parameter("method", request.name, answer)
        else:
            self._trigger(TRIGGERED[request.do], answer)

    def _trigger(self, names: Sequence[str], answer: Answer) -> None:
        """Call every one of these services that is there; the first that succeeds answers, else the last."""
        ready = [self._triggers[name] for name in names if self._triggers[name].service_is_ready()]
        if not ready:
            nodes = " and ".join(name.partition("/")[0] for name in names)
            answer((False, f"{nodes}: not in the graph; nothing was done"))
        left = len(ready)

        def answered(future: Future) -> None:
            nonlocal left
            left -= 1
            success, text = _outcome(future, lambda done: (bool(done.success), str(done.message)))
            if success or not left:
                answer((success, text))

        for client in ready:
            client.call_async(Trigger.Request()).add_done_callback(answered)

    def _set_parameter(self, name: str, value: bool | str, answer: Answer) -> None:
        if not self._set.service_is_ready():
            answer((False, f"{SELECTOR}: not in the graph; nothing was done"))
            return
        request = SetParameters.Request(parameters=[_message(name, value)])

        def answered(future: Future) -> None:
            done = f"{SELECTOR}: {name} is {str(value).lower() if isinstance(value, bool) else value}"
            answer(_outcome(future, lambda found: (found.results[0].successful, found.results[0].reason or done)))

        self._set.call_async(request).add_done_callback(answered)


def _message(name: str, value: bool | str) -> ParameterMessage:
    return Parameter(name, value=value).to_parameter_msg()


def _outcome(future: Future, read: Callable[[Any], tuple[bool, str]]) -> tuple[bool, str]:
    if future.exception() is not None:
        return False, f"no answer: {future.exception()}"
    return read(future.result())
