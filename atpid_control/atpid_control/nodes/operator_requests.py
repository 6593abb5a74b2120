# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Does what the live page asks for, by the services and topics that anybody at the stand may use."""

from collections.abc import Callable
from functools import partial
from typing import Any

from atpid_interfaces.msg import Event
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.events import EventPublisher
from atpid_control.views.live.requests import HoldRequest, MethodRequest, Note, Plain, Request

Answer = Callable[[tuple[bool, str]], None]
MOTOR, SUPERVISOR, ARM = "motor_node/stop", "supervisor_node/stop", "supervisor_node/rearm"
EXCITER = "excitation_node/stop"
#: Services (std_srvs/Trigger) of each request, all of which are called; the first of them in the graph answers it.
#: A stop is latched in the supervisor and reaches the motor at once: whether it is off, the motor itself confirms.
TRIGGERED = {"stop": (MOTOR, SUPERVISOR, EXCITER), "disarm": (MOTOR,), "arm": (ARM,)}
SELECTOR = "selector_node"


class OperatorRequests:
    """Calls the services; `do` may be called from any thread, the answers come while the node spins."""

    def __init__(self, node: Node, events: EventPublisher) -> None:
        """Make the clients."""
        self._node, self._events = node, events
        self._triggers = {name: node.create_client(Trigger, name) for name in (MOTOR, SUPERVISOR, ARM, EXCITER)}
        self._set = node.create_client(SetParameters, f"{SELECTOR}/set_parameters")

    def do(self, request: Request, answer: Answer) -> None:
        """Do a request; `answer` is called once, with success and one line."""
        if isinstance(request, Note):
            self._events.publish(Event.INFO, Event.NOTE, request.text)
            answer((True, f"noted: {request.text}"))
        elif isinstance(request, HoldRequest):
            done = "the ceiling is held" if request.on else "the controller goes on"
            self._set_parameter("hold", request.on, done, answer)
        elif isinstance(request, MethodRequest):
            self._set_parameter("method", request.name, f"{SELECTOR}: method is {request.name}", answer)
        else:
            self._trigger(request, answer)

    def _trigger(self, request: Plain, answer: Answer) -> None:
        names = TRIGGERED[request.do]
        ready = [name for name in names if self._triggers[name].service_is_ready()]
        if not ready:
            nodes = " and ".join(name.partition("/")[0] for name in names)
            answer((False, f"{nodes}: not in the graph; nothing was done"))
            return
        answers = [self._triggers[name].call_async(Trigger.Request()) for name in ready]
        answers[0].add_done_callback(lambda future: answer(_outcome(future, partial(_in_words, ready[0]))))

    def _set_parameter(self, name: str, value: bool | str, done: str, answer: Answer) -> None:
        if not self._set.service_is_ready():
            answer((False, f"{SELECTOR}: not in the graph; nothing was done"))
            return
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])

        def answered(future: Future) -> None:
            answer(_outcome(future, lambda found: (found.results[0].successful, found.results[0].reason or done)))

        self._set.call_async(request).add_done_callback(answered)


def _in_words(service: str, found: Any) -> tuple[bool, str]:
    """Return success and one line of an answer; of the motor itself in the words of the page."""
    if service != MOTOR:
        return bool(found.success), str(found.message)
    if found.success:
        return True, "motor off, confirmed by the motor node; Arm again arms it"
    return False, f"motor off is not confirmed: use the emergency stop ({found.message})"


def _outcome(future: Future, read: Callable[[Any], tuple[bool, str]]) -> tuple[bool, str]:
    if future.exception() is not None:
        return False, f"no answer: {future.exception()}"
    return read(future.result())
