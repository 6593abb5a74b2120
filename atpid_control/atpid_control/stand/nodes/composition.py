# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The graph as the bench runs it: in lockstep all nodes on one executor, or watched from outside in real time."""

from __future__ import annotations

import importlib
import math
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import rclpy
from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, Excitation
from rcl_interfaces.msg import Log
from rclpy.client import Client
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from atpid_common.files import Document
from atpid_common.interrupt import Interrupt
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import EVENTS, STATES, nanoseconds_of
from atpid_common.nodes.node_main import PARAMETERS, command_node, initialise
from atpid_common.nodes.parameters import refuse_undeclared
from atpid_common.nodes.turns import TurnExecutor
from atpid_common.waiting import ANNOUNCE_AFTER, COMPILING, announced, to_stderr
from atpid_control.stand.parameters import BenchError, NodeDiedError, Parameters, PlantFailedError
from atpid_control.stand.parts import EXCITER, PARTS, Part, added_part

Progress = Callable[[float], None]
QUIET = ["--ros-args", "--disable-stdout-logs"]
#: Between the end of a run's source and that of its watch [s]: see `leaving` in atpid_common/nodes/node_main.py.
_APART = 0.2

#: The handshake takes seconds where discovery is slow; a block takes milliseconds, a selection by simulation more [s].
_HANDSHAKE_TIMEOUT, _LOOP_TIMEOUT = 30.0, 60.0
#: Every entity costs time in every round of the executor, and parameter services are not used in a run.
_NODE_OPTIONS = {"start_parameter_services": False, "enable_rosout": False}


def node_class(package: str, name: str) -> type[Node]:
    """Return the class behind the executable `name` of `package`: in `<package>.nodes.<name>`, of the same letters.

    Found by name, as `ros2 run` finds it, so that no package has to import another for being run together.
    """
    module = importlib.import_module(f"{package}.nodes.{name}")
    found: type[Node] = next(item for key, item in vars(module).items() if key.lower() == name.replace("_", ""))
    return found


def make_node(part: Part, values: Document, **options: object) -> Node:
    """Return a node of this process, with its parameters; what it refuses is raised as it is."""
    overrides = [Parameter(key, value=value) for key, value in values.items()]
    return node_class(part.package, part.name)(parameter_overrides=overrides, **options)


@contextmanager
def _graph(parameters: Parameters) -> Iterator[tuple[Executor, dict[str, Node]]]:
    """Start the nodes that have parameters on one single-threaded executor: fast, and the same every time.

    In the end they are closed in reverse order: the recorder, last in, closes its bag first, Ctrl-C or not.
    """
    excited = [added_part(EXCITER).part] if EXCITER in parameters else []
    nodes: dict[str, Node] = {}
    undo = ExitStack()
    try:
        # one context for all: nodes use the default one unless another is given
        initialise(QUIET)
        undo.callback(rclpy.try_shutdown)
        executor = TurnExecutor()
        undo.callback(executor.shutdown)
        for part in (PARTS[0], *excited, *PARTS[1:]):
            if part.name not in parameters:
                continue
            node = make_node(part, parameters[part.name], **_NODE_OPTIONS)
            undo.callback(node.destroy_node)
            refuse_undeclared(node, [row.name for row in PARAMETERS])  # of processes only
            if hasattr(node, "close"):
                undo.callback(node.close)
            nodes[part.name] = node
            executor.add_node(node)
        yield executor, nodes
    finally:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            undo.close()
        finally:
            signal.signal(signal.SIGINT, before)


#: Called with the simulated time [s] and a message.
Follow = Callable[[float, Any], None]
_FOLLOWED = {
    "events": Event,
    "excitation": Excitation,
    "ceiling/command": CeilingCommand,
    "ceiling/state": CeilingState,
}


def run_lockstep(
    parameters: Parameters, progress: Progress, follow: Follow | None = None, calls: Sequence[tuple[float, str]] = ()
) -> None:
    """Run the graph until the plant is done; `progress` is called with the simulated time [s].

    The next block follows as soon as the loop has answered the last.
    follow: is called with each message of `_FOLLOWED`, and with the time the plant has reached when it came.
    calls: services (std_srvs/Trigger) that are called once the plant has reached their time [s], in rising order.

    Raises PlantFailedError where the plant fails, NodeDiedError where another node ends, BenchError where handshake
    or loop stops, with what is missing.
    """
    with ExitStack() as stack:
        with announced(COMPILING):
            executor, nodes = stack.enter_context(_graph(parameters))
        plant = nodes["plant_node"]
        waiting = _follow(plant, follow, calls)
        others = {name: node for name, node in nodes.items() if node is not plant and hasattr(node, "done")}
        computed, since, reported = -1, time.monotonic(), False
        turn = stack.enter_context(_uninterrupted(executor))
        while not plant.done.done():
            turn(0.1)
            _check(others)
            if plant.stream.computed_ticks != computed:
                computed, since = plant.stream.computed_ticks, time.monotonic()
                progress(computed / plant.stream.rate)
                while waiting and waiting[0][0] <= computed / plant.stream.rate:
                    waiting.pop(0)[1].call_async(Trigger.Request())
            elif computed <= 0 and not reported and time.monotonic() - since > ANNOUNCE_AFTER:
                reported = True
                to_stderr(f"no samples yet: waiting for {plant.waiting_for()}")
            elif time.monotonic() - since > (_LOOP_TIMEOUT if computed > 0 else _HANDSHAKE_TIMEOUT):
                raise BenchError(_stopped(plant, computed))
        if plant.failure:
            raise PlantFailedError(plant.failure)


@contextmanager
def _uninterrupted(executor: Executor) -> Iterator[Callable[[float], None]]:
    """Yield a function that spins once, for up to so many seconds; what asks the process to end is raised after it.

    Raised inside, in rclpy's C++, KeyboardInterrupt becomes another error, or is lost.
    """
    with Interrupt() as interrupt:
        interrupt.defer()

        def turn(seconds: float) -> None:
            executor.spin_once(timeout_sec=seconds)
            if interrupt.received:
                raise KeyboardInterrupt

        yield turn
    if interrupt.received:  # after the last look, before the former handlers were back
        raise KeyboardInterrupt


def _follow(plant: Node, follow: Follow | None, calls: Sequence[tuple[float, str]]) -> list[tuple[float, Client]]:
    """Subscribe `follow`; return the time and the client of each call."""
    if follow is not None:

        def received(message: object) -> None:
            follow(plant.stream.computed_ticks / plant.stream.rate, message)

        bare = SubscriptionEventCallbacks(use_default_callbacks=False)
        for topic, kind in _FOLLOWED.items():
            plant.create_subscription(kind, topic, received, EVENTS, event_callbacks=bare)
    return [(time, plant.create_client(Trigger, service)) for time, service in calls]


def _check(nodes: Mapping[str, Node]) -> None:
    """Raise NodeDiedError where a node has ended: the recorder on a full disk, for example."""
    for name, node in nodes.items():
        if node.done.done():
            reason = getattr(node, "error", "") or f"status {node.done.result()}; see log/"
            raise NodeDiedError(f"{name} ended: {reason}")


def _stopped(plant: Node, computed: int) -> str:
    if computed == 0:
        return f"the graph did not get ready within {_HANDSHAKE_TIMEOUT:g} s: still waiting for {plant.waiting_for()}"
    stopped = f"the loop stopped at {computed / plant.stream.rate:g} s"
    return f"{stopped}: no ceiling/state answered the last block within {_LOOP_TIMEOUT:g} s (see log/)"


#: Motor and exciter at once, and the supervisor, in which a stop is latched.
_STOPPED_BY = ("motor_node", "excitation_node", "supervisor_node")
ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class BenchWatch(Node):
    """Follows the estimates' stamps, the events and, until the first estimate, the log; passes on the operator's stop.

    It publishes an event where a node was started again, and nothing else.
    """

    def __init__(self, report: Callable[[str], None], **node_options: object) -> None:
        """Subscribe. `report` is called with each warning, and with what is compiled, before the first estimate."""
        super().__init__("bench_watch", **node_options)
        self.elapsed = 0.0  # data time since the first estimate [s]
        self.failure = ""  # why the plant failed, one sentence
        self._report = report
        self._reported: set[str] = set()
        self._first: int | None = None
        self._first_arrived = math.inf  # when the first estimate did, by the wall clock, which stamps the log [s]
        subscribe(self, Excitation, "excitation", self._on_excitation, STATES)
        subscribe(self, Event, "events", self._on_event, EVENTS)
        self.create_subscription(Log, "/rosout", self._on_log, ROSOUT)
        self._events = EventPublisher(self)
        self._stops = [self.create_client(Trigger, f"{name}/stop") for name in _STOPPED_BY]

    def restarted(self, text: str) -> None:
        """Publish that a node was started again."""
        self._events.publish(Event.ALARM, Event.SUPERVISION, text)

    def stop_motor(self) -> None:
        """Ask for motor and exciter to be disarmed, from any thread; the answers are printed while it spins."""
        ready = [client for client in self._stops if client.service_is_ready()]
        if not ready:
            to_stderr("no motor node and no supervisor yet: there is nothing to stop")
        for client in ready:
            client.call_async(Trigger.Request()).add_done_callback(lambda answer: to_stderr(answer.result().message))

    def _on_excitation(self, message: Excitation) -> None:
        if message.handshake:
            return
        now = nanoseconds_of(message.header.stamp)
        if self._first is None:
            self._first, self._first_arrived = now, time.time()
        self.elapsed = (now - self._first) * 1e-9

    def _on_event(self, event: Event) -> None:
        if event.kind == Event.FAILED:
            self.failure = event.text

    def _on_log(self, log: Log) -> None:
        text = f"{log.name}: {log.msg}"
        relevant = log.level >= Log.WARN or log.msg.startswith(COMPILING)
        # by its stamp: a busy machine delivers a line of the start after the first estimate
        early = log.stamp.sec + log.stamp.nanosec * 1e-9 <= self._first_arrived
        if relevant and early and text not in self._reported:
            self._reported.add(text)
            self._report(text)


@contextmanager
def watching(report: Callable[[str], None], namespace: str = "") -> Iterator[tuple[BenchWatch, Callable[[], None]]]:
    """Yield the watch and a function that spins it for up to a twentieth of a second: a node that ends is seen then."""
    with command_node(lambda: BenchWatch(report, namespace=namespace), *QUIET) as (watch, executor):

        def listen() -> None:
            with _uninterrupted(executor) as turn:
                turn(0.05)

        yield watch, listen
        time.sleep(_APART)
