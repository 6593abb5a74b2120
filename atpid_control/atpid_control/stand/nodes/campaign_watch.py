# SPDX-License-Identifier: Apache-2.0
"""The campaign's node in a stand's graph: it commands the excitation, sets the selector, and collects what is answered.

The ceiling has one commander, the selector: a height goes to its parameter `manual_height`.
"""

import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
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
from rcl_interfaces.srv import SetParameters
from rclpy.client import Client
from rclpy.parameter import Parameter
from rclpy.task import Future

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.messages import EVENTS, STATES, STATUS, STEADY
from atpid_common.nodes.node_main import command_node
from atpid_common.waiting import to_stderr
from atpid_control.stand.errors import BenchError
from atpid_control.stand.nodes.composition import QUIET, BenchWatch

#: Between two commands of the excitation, which stops where none comes [s].
_PERIOD = 0.2
#: How long the selector may take to take a parameter [s]: it may be loading a method.
_ANSWER = 30.0
#: Between two looks whether something has come [s].
_LOOK = 0.05


class CampaignWatch(BenchWatch):
    """Publishes the excitation's command on its own period; what is received waits in `received`."""

    def __init__(self, **node_options: Any) -> None:
        """Subscribe and publish; nothing is commanded yet."""
        super().__init__(to_stderr, **node_options)
        self.received: deque[Any] = deque(maxlen=10_000)
        self.ceiling, self.recorder, self.exciter = CeilingState(), RecorderStatus(), ExcitationState()
        self.blocks = 0
        self.plant = False  # whether a simulated one waits for its loop
        self._wanted = ExcitationCommand(kind=ExcitationCommand.OFF)
        self._commands = self.create_publisher(ExcitationCommand, "excitation/command", STATES)
        for kind, topic, profile in (
            (Event, "events", EVENTS), (Excitation, "excitation", STATES), (CeilingState, "ceiling/state", STATES),
            (ExcitationState, "excitation/state", STATES), (RecorderStatus, "recorder/status", STATUS),
        ):  # fmt: skip
            subscribe(self, kind, topic, self._on_message, profile)
        subscribe(self, PlantTruth, "plant/truth", self._on_plant, STATES)
        self._set_parameters = self.create_client(SetParameters, "selector_node/set_parameters")
        self._timer = self.create_timer(_PERIOD, self._command, clock=STEADY)

    def excite(self, amplitude: float, frequency: float) -> None:
        """Command a tone of `amplitude` [m, N] at `frequency` [Hz], held on what is identified; 0: off."""
        kind = ExcitationCommand.SINE if amplitude else ExcitationCommand.OFF
        nan = float("nan")
        self._wanted = ExcitationCommand(
            sequence=self._wanted.sequence + 1, kind=kind, hold=bool(amplitude), amplitude=amplitude,
            frequency=frequency, end_frequency=nan, duration=nan,
        )  # fmt: skip
        self._command()

    def select(self, method: str, height: float) -> None:
        """Let the selector send the ceiling to `height` [m], or for 0 where `method` has it. Raises BenchError."""
        values = {"manual_height": height} | ({"method": method} if method else {})
        made = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        answer = self._answer(self._set_parameters, SetParameters.Request(parameters=made), "selector_node")
        if refused := [result.reason for result in answer.results if not result.successful]:
            raise BenchError(f"the selector refuses {values}: {refused[0]}")

    def start(self, name: str) -> None:
        """Configure and activate a lifecycle node. Raises BenchError."""
        client = self.create_client(ChangeState, f"{name}/change_state")
        for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            request = ChangeState.Request(transition=Transition(id=transition))
            if not self._answer(client, request, name).success:
                raise BenchError(f"{name} cannot be started: see its log")

    def _answer(self, client: Client, request: Any, name: str) -> Any:
        """Return the answer of a service. Raises BenchError: there is none."""
        answer: Future | None = None
        deadline = time.monotonic() + _ANSWER
        while answer is None or not answer.done():
            if answer is None and client.service_is_ready():
                answer = client.call_async(request)
            if time.monotonic() > deadline:
                raise BenchError(f"{name} has not answered within {_ANSWER:g} s")
            time.sleep(_LOOK)
        return answer.result()

    def _on_plant(self, _message: PlantTruth) -> None:
        self.plant = True

    def _command(self) -> None:
        self._wanted.header.stamp = self.get_clock().now().to_msg()
        self._commands.publish(self._wanted)

    def _on_message(self, message: Any) -> None:
        if isinstance(message, CeilingState):
            self.ceiling = message
        elif isinstance(message, RecorderStatus):
            self.recorder = message
        elif isinstance(message, ExcitationState):
            self.exciter = message
        elif isinstance(message, Excitation):
            self.blocks += not message.handshake
        self.received.append(message)


@contextmanager
def taking_part(namespace: str = "") -> Iterator[CampaignWatch]:
    """Yield the node, which works in a thread: the excitation goes on while a bag is read."""
    ended = threading.Event()
    with command_node(lambda: CampaignWatch(namespace=namespace), *QUIET) as (watch, executor):

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
