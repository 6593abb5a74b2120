# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serves the live page (docs/live.md): receives what the graph publishes, and calls its services for the operator.

A process of its own with a low priority. No node waits for it: what it cannot take in time is not sent again.
"""

import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial

from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    Excitation,
    PlantTruth,
    RecorderStatus,
    SampleBlock,
    SupervisorState,
)
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import TOPIC as DIAGNOSTICS
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import EVENTS_KEPT, STATUS
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.parameters import Entry
from atpid_control.selection.registry import methods
from atpid_control.views.live.address import HOST, PORT, TOKEN, address_of, require_library
from atpid_control.views.live.requests import HoldRequest, MethodRequest, Note, Plain, Request
from atpid_control.views.live.view import LiveView
from atpid_sim.scene import load_scene

Answer = Callable[[tuple[bool, str]], None]
MOTOR, SUPERVISOR, ARM = "motor_node/stop", "supervisor_node/stop", "supervisor_node/rearm"
EXCITER, _ARM_EXCITER = "excitation_node/stop", "excitation_node/rearm"
#: Services (std_srvs/Trigger) of each request, all of which are called. A stop is latched in the supervisor and reaches
#: the drives at once: whether they are off they confirm themselves, and the supervisor where there is none of them.
_TRIGGERED = {"stop": (MOTOR, SUPERVISOR, EXCITER), "disarm": (MOTOR,), "arm": (ARM,), "arm_exciter": (_ARM_EXCITER,)}
#: How the page names a drive, and what arms it there.
DRIVES = {MOTOR: ("motor", "Arm again"), EXCITER: ("exciter", "Arm exciter")}
SELECTOR = "selector_node"


class OperatorRequests:
    """Calls the services; `do` may be called from any thread, the answers come while the node spins."""

    def __init__(self, node: Node, events: EventPublisher) -> None:
        self._node, self._events = node, events
        names = {name for triggered in _TRIGGERED.values() for name in triggered}
        self._triggers = {name: node.create_client(Trigger, name) for name in names}
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
        names = _TRIGGERED[request.do]
        ready = [name for name in names if self._triggers[name].service_is_ready()]
        if not ready:
            nodes = " and ".join(name.partition("/")[0] for name in names)
            answer((False, f"{nodes}: not in the graph; nothing was done"))
            return
        answering = [name for name in ready if name != SUPERVISOR] or ready
        outcomes: list[tuple[bool, str]] = []

        def answered(name: str, future: Future) -> None:
            outcomes.append(_outcome(future, partial(_in_words, name)))
            if len(outcomes) == len(answering):
                answer((all(success for success, _ in outcomes), "; ".join(text for _, text in outcomes)))

        for name in ready:
            future = self._triggers[name].call_async(Trigger.Request())
            if name in answering:
                future.add_done_callback(partial(answered, name))

    def _set_parameter(self, name: str, value: bool | str, done: str, answer: Answer) -> None:
        if not self._set.service_is_ready():
            answer((False, f"{SELECTOR}: not in the graph; nothing was done"))
            return
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])

        def answered(future: Future) -> None:
            answer(_outcome(future, lambda found: (found.results[0].successful, found.results[0].reason or done)))

        self._set.call_async(request).add_done_callback(answered)


def _in_words(service: str, found: Trigger.Response) -> tuple[bool, str]:
    """Return success and one line of an answer; of a drive that is stopped in the words of the page."""
    if service not in DRIVES:
        return bool(found.success), str(found.message)
    drive, arms = DRIVES[service]
    if found.success:
        return True, f"{drive} off, confirmed by the {service.partition('/')[0]}; {arms} arms it"
    return False, f"{drive} off is not confirmed: use the emergency stop ({found.message})"


def _outcome(future: Future, read: Callable[..., tuple[bool, str]]) -> tuple[bool, str]:
    if future.exception() is not None:
        return False, f"no answer: {future.exception()}"
    return read(future.result())


PARAMETERS = (
    Entry("scene", "", "scene file, for the efficiency and the size of the grain; empty: neither is shown"),
    Entry("host", HOST, "address to serve the page on; another than the loopback needs a token"),
    Entry("port", PORT, "TCP port of the page; 0: a free one", "", 0, 65535),
)
#: What is not received in time is not needed: an eighth of a second of the most frequent topic.
_NEWEST = QoSProfile(depth=6, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Nice value of the process: every node of the loop comes first.
_NICE = 10


class LiveNode(Node):
    """Parameters, topics, and one call into the view for each message."""

    def __init__(self, **node_options: object) -> None:
        """Serve the page. Raises LiveError, ParameterError or SceneError, in one line."""
        super().__init__("live_node", **node_options)
        values = declare(self, PARAMETERS)
        require_library()
        from atpid_control.views.live.server import LiveServer  # needs the library

        address = address_of(values["host"], values["port"])
        self.view = LiveView(load_scene(values["scene"]) if values["scene"] else None)
        self._events = EventPublisher(self)
        requests = OperatorRequests(self, self._events)
        self._receive()
        self.server = LiveServer(self.view, requests.do, address, methods())

    def _receive(self) -> None:
        view = self.view
        for topic, kind, take in (
            ("sensors/laser", SampleBlock, view.on_block),
            ("plant/truth", PlantTruth, view.on_truth),
            ("excitation", Excitation, view.on_excitation),
            ("ceiling/command", CeilingCommand, partial(view.on_state, "ceiling/command")),
            ("ceiling/state", CeilingState, partial(view.on_state, "ceiling/state")),
            ("supervisor/state", SupervisorState, partial(view.on_state, "supervisor/state")),
        ):
            subscribe(self, kind, topic, partial(_pass_on, take), _NEWEST)
        subscribe(self, Event, "events", partial(_pass_on, view.on_event), EVENTS_KEPT)
        recorder = partial(view.on_state, "recorder/status")
        subscribe(self, RecorderStatus, "recorder/status", partial(_pass_on, recorder), STATUS)
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, partial(_pass_on, view.on_diagnostics), _NEWEST)

    def close(self) -> None:
        """End the page."""
        self.server.close()


def _pass_on(take: Callable[..., None], message: object) -> None:
    """Pass a message to the view with the steady time; handshakes carry nothing."""
    if not getattr(message, "handshake", False):
        take(message, time.monotonic())


def _announced() -> LiveNode:
    """Make the node and print the page's address; who gave the token has printed it."""
    node = LiveNode()
    address = node.server.address
    if not address.token or os.environ.get(TOKEN, "") != address.token:
        print(f"live page: {address.url}", flush=True)
    return node


def main(args: Sequence[str] | None = None) -> int:
    """Run the live page as a process of its own, with a low priority; return the exit status."""
    os.nice(_NICE)
    return run_node(_announced, args)


if __name__ == "__main__":
    sys.exit(main())
