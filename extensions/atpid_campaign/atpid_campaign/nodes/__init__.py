# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The campaign's node in a stand's graph: it commands the excitation, sets the selector, and collects what is answered.

The ceiling has one commander, the selector: a height goes to its parameter `manual_height`.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from atpid_interfaces.msg import (
    CeilingState,
    Event,
    Excitation,
    ExcitationCommand,
    ExcitationState,
    PlantTruth,
    RecorderStatus,
)
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_srvs.srv import Trigger

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import EVENTS, STATES, STATUS, STEADY
from atpid_common.nodes.node_main import command_node
from atpid_common.vocabulary import Frame
from atpid_common.waiting import to_stderr
from atpid_control.stand.nodes.composition import QUIET, BenchWatch
from atpid_control.stand.parameters import BenchError

#: Between two commands of the excitation, which stops where none comes [s].
_PERIOD = 0.2
#: How long the selector may take to take a parameter [s]: it may be loading a method.
_ANSWER = 30.0
#: Between two looks whether something has come [s].
_LOOK = 0.05


class _CampaignWatch(BenchWatch):
    """Publishes the excitation's command on its own period; what a judge needs waits in `received`."""

    def __init__(self, namespace: str) -> None:
        super().__init__(to_stderr, namespace=namespace)
        self.received: deque[Event | Excitation | CeilingState] = deque(maxlen=10_000)
        self.ceiling, self.recorder, self.exciter = CeilingState(), RecorderStatus(), ExcitationState()
        self.plant: PlantTruth | None = None  # a simulated one that has published waits for its loop
        self._asked = ExcitationCommand(kind=ExcitationCommand.OFF)
        self._commands = self.create_publisher(ExcitationCommand, "excitation/command", STATES)
        for kind, topic, name, profile in (
            (Event, "events", "", EVENTS),
            (Excitation, "excitation", "", STATES),
            (CeilingState, "ceiling/state", "ceiling", STATES),
            (PlantTruth, "plant/truth", "plant", STATES),
            (ExcitationState, "excitation/state", "exciter", STATES),
            (RecorderStatus, "recorder/status", "recorder", STATUS),
        ):
            subscribe(self, kind, topic, partial(self._take, name), profile)
        self._selector = AsyncParameterClient(self, "selector_node")
        self._timer = self.create_timer(_PERIOD, self._command, clock=STEADY)

    def excite(self, amplitude: float, frequency: float) -> None:
        """Command a tone of `amplitude` [m, N] at `frequency` [Hz], held on what is identified; 0: off."""
        kind = ExcitationCommand.SINE if amplitude else ExcitationCommand.OFF
        asked = ExcitationCommand(sequence=self._asked.sequence + 1, kind=kind, hold=bool(amplitude))
        asked.amplitude, asked.frequency = amplitude, frequency
        asked.end_frequency = asked.duration = float("nan")
        self._asked = asked
        self._command()

    def select(self, method: str, height: float) -> None:
        """Let the selector send the ceiling to `height` [m], or for 0 where `method` has it. Raises BenchError."""
        values = {"manual_height": height} | ({"method": method} if method else {})
        made = [Parameter(name, value=value) for name, value in values.items()]
        ready, ask = self._selector.services_are_ready, partial(self._selector.set_parameters, made)
        answer = _answered(ready, ask, "selector_node")
        if refused := [result.reason for result in answer.results if not result.successful]:
            raise BenchError(f"the selector refuses {values}: {refused[0]}")

    def start(self, name: str) -> None:
        """Configure and activate a lifecycle node. Raises BenchError."""
        client = self.create_client(ChangeState, f"{name}/change_state")
        for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            request = ChangeState.Request(transition=Transition(id=transition))
            if not _answered(client.service_is_ready, partial(client.call_async, request), name).success:
                raise BenchError(f"{name} cannot be started: see its log")

    def arm(self) -> str:
        """Arm motor and exciter. Return why one is not armed, one line; empty: both are. Raises BenchError."""
        for name in ("supervisor_node", "excitation_node"):
            client = self.create_client(Trigger, f"{name}/rearm")
            answer = _answered(client.service_is_ready, partial(client.call_async, Trigger.Request()), name)
            if not answer.success:
                return str(answer.message)
        return ""

    def _take(self, name: str, message: object) -> None:
        if name:
            setattr(self, name, message)
        if isinstance(message, Event | Excitation | CeilingState):
            self.received.append(message)

    def _command(self) -> None:
        header = self._asked.header
        header.stamp, header.frame_id = self.get_clock().now().to_msg(), Frame.SUPPORT
        self._commands.publish(self._asked)


def _answered(ready: Callable[[], bool], call: Callable[[], Future], name: str) -> Any:
    """Return the answer of a service, called once it is there. Raises BenchError: there is none."""
    answer: Future | None = None
    deadline = time.monotonic() + _ANSWER
    while answer is None or not answer.done():
        if answer is None and ready():
            answer = call()
        if time.monotonic() > deadline:
            raise BenchError(f"{name} has not answered within {_ANSWER:g} s")
        time.sleep(_LOOK)
    return answer.result()


@contextmanager
def taking_part(namespace: str = "") -> Iterator[_CampaignWatch]:
    """Yield the node, which works in a thread: the excitation goes on while a bag is read."""
    ended = threading.Event()
    with command_node(lambda: _CampaignWatch(namespace), *QUIET) as (watch, executor):

        def work() -> None:
            while not ended.is_set():
                executor.spin_once(timeout_sec=_LOOK)

        thread = threading.Thread(target=work, name="campaign", daemon=True)
        thread.start()
        try:
            yield watch
        finally:
            ended.set()
            thread.join()
