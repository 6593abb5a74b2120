# SPDX-License-Identifier: Apache-2.0
"""Answers each excitation estimate with one ceiling command, and selects heights on request."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, Excitation
from atpid_interfaces.srv import SelectHeight
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import ParameterUninitializedException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import STATES, nanoseconds_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.single_instance import StartedTwiceError, check_alone
from atpid_common.waiting import COMPILING, announced
from atpid_control.control_setup import controller_of, selector_of
from atpid_control.controller import Answer, Command, Controller
from atpid_control.hold import Estimate, HoldError, Quality
from atpid_control.nodes.height_services import HeightServices, refused, select_height
from atpid_control.nodes.map_server import MapServer
from atpid_control.nodes.search_server import SearchServer
from atpid_control.selection import SelectionError
from atpid_control.selection.search_run import SearchingController
from atpid_sim.nodes.scene_parameter import scene_given
from atpid_sim.scene import ControlledCeiling, Scene

BAD_INPUT = 2
#: A command answers each block; a gap this long means that the controller or the sensors are gone [s].
COMMAND_DEADLINE = 0.5

TYPES = Parameter.Type
PARAMETERS: tuple[tuple[str, Any, str], ...] = (
    ("scene", "", "scene file: the system, the ceiling's range and the frequency the heights are for"),
    ("map", "", "height map for the look-up; empty: the one the scene names"),
    ("method", "", "lookup, pca, direct, search or fixed; empty: the scene's controller"),
    ("lockstep", False, "true: commands wait in a queue; false: only the newest counts"),
    ("dead_band", TYPES.DOUBLE, "relative change of amplitude that moves nothing [-]"),
    ("sigmas", TYPES.DOUBLE, "a change must also exceed this many standard deviations [-]"),
    ("steady_count", TYPES.INTEGER, "consecutive agreeing steady estimates that are acted on"),
    ("rising_count", TYPES.INTEGER, "consecutive rising estimates that are a ramp to follow"),
    ("falling_count", TYPES.INTEGER, "consecutive lower estimates before the ceiling goes down"),
    ("frequency_tolerance", TYPES.DOUBLE, "relative distance from resonance at which heights still hold [-]"),
    ("step_back", TYPES.DOUBLE, "share of the clearance given up when the beam rumbles [-]"),
    ("settle_count", TYPES.INTEGER, "estimates after the ceiling has come to rest in which the beam may do anything"),
    ("rumble_count", TYPES.INTEGER, "estimates in a row that rumble after that, before the ceiling steps back"),
    ("step_back_excess", TYPES.DOUBLE, "amplitude of the beam above the predicted that is more than inaccuracy [-]"),
    ("step_back_memory", TYPES.DOUBLE, "change of the excitation's amplitude over which a step back is remembered [-]"),
    ("drift_tolerance", TYPES.DOUBLE, "what the model may be off before the beam is said to drift from it [-]"),
    ("drift_noise", TYPES.DOUBLE, "scatter of the beam's amplitude from period to period, one standard deviation [-]"),
    ("drift_periods", TYPES.DOUBLE, "settled periods between false alarms of a model that is off by all it may"),
    ("margin", TYPES.DOUBLE, "standard deviations of the amplitude the height must be safe for [-]"),
    (
        "stiffness_uncertainty",
        TYPES.DOUBLE,
        "with a margin, what `direct` takes the model's stiffness to be off by [-]",
    ),
)


class SelectorNode(Node):
    """Parameters, topics, one service, and one call into the controller for each estimate."""

    def __init__(self, *, parameter_overrides: list[Parameter] | None = None, **node_options: Any) -> None:
        """Read scene and map; raise a ValueError of our own where they do not fit. `done`: exit status."""
        super().__init__("selector_node", parameter_overrides=parameter_overrides, **node_options)
        for name, default, text in PARAMETERS:
            self.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=True))
            self._value(name)  # refused now, before anything is loaded
        scene = scene_given(self)
        self._block = scene.recording.block
        self._lockstep = bool(self._value("lockstep"))
        self._selector = selector_of(self._value, self._method(scene), scene, self._map_file(scene))
        self._controller = self._make_controller(scene)
        self.done: Future = Future()
        self._latest: Estimate | None = None
        self._start_ns: int | None = None
        self._height = math.nan
        self._make_topics()
        self._method_services = HeightServices(
            self, scene, self._map_file(scene), lambda: self._latest, lambda: self._height
        )
        self._maps = MapServer(self)
        # a ceiling that no controller moves cannot be searched
        borrowed = self._controller if isinstance(self._controller, SearchingController) else None
        self._search = SearchServer(self, borrowed) if borrowed else None
        self._alone_timer = self.create_timer(1.0, self._stay_alone, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _value(self, name: str) -> Any:
        try:
            return self.get_parameter(name).value
        except ParameterUninitializedException:
            raise HoldError(f"parameter {name} is not set: start with --ros-args --params-file selector.yaml") from None

    def _method(self, scene: Scene) -> str:
        given = str(self._value("method"))
        return given or (scene.ceiling.controller if isinstance(scene.ceiling, ControlledCeiling) else "fixed")

    def _map_file(self, scene: Scene) -> Path | None:
        given = str(self._value("map"))
        return Path(given) if given else getattr(scene.ceiling, "map", None)

    def _make_controller(self, scene: Scene) -> Controller:
        if isinstance(scene.ceiling, ControlledCeiling):
            # once for nothing: a method that simulates loads its kernels now, not while the structure vibrates
            with suppress(SelectionError), announced(COMPILING, self.get_logger().info):
                self._selector.select(scene.grain.radius, frequency=scene.frequency_hz)
            return SearchingController(controller_of(self._value, scene, self._selector), scene.ceiling.range)
        return controller_of(self._value, scene, self._selector)

    def _make_topics(self) -> None:
        lockstep = self._lockstep
        command = QoSProfile(depth=10 if lockstep else 1, reliability=ReliabilityPolicy.RELIABLE)
        if not lockstep:
            command.deadline = Duration(seconds=COMMAND_DEADLINE)
        self._commands = self.create_publisher(CeilingCommand, "ceiling/command", command)
        self._events = EventPublisher(self)
        # before the estimates: whoever says rumble says it before the estimate of the same block
        self.create_subscription(Event, "events", self._on_event, STATES)
        self.create_subscription(Excitation, "excitation", self._on_excitation, STATES)
        self.create_subscription(CeilingState, "ceiling/state", self._on_state, STATES)
        self.create_service(SelectHeight, "~/select", self._on_select)

    def _on_state(self, state: CeilingState) -> None:
        self._height = state.height

    def _on_event(self, event: Event) -> None:
        if event.header.frame_id != self.get_name():
            self._controller.hear(event.kind)

    def _on_excitation(self, message: Excitation) -> None:
        if message.handshake:
            self._publish(message, Command(reason="handshake"))
            return
        now = nanoseconds_of(message.header.stamp)
        if self._start_ns is None:
            # the first stamp is that of the first block's last sample
            self._start_ns = now - round(self._block * 1e9)
        estimate = Estimate(
            message.quality, message.amplitude, message.amplitude_std, message.frequency, message.beam_amplitude
        )
        if estimate.quality == Quality.STEADY:
            self._latest = estimate
        begun = time.monotonic()
        answer = self._controller.answer((now - self._start_ns) * 1e-9, estimate, self._height)
        self._publish(message, answer.command)
        if self._search:
            self._search.report()
        if answer.kind:
            self._tell(message, answer)
        self._tell_slow(message, time.monotonic() - begun)

    def _tell_slow(self, answered: Excitation, taken: float) -> None:
        """Say that a selection has held up the loop; not in lockstep, which waits and says nothing of the machine."""
        if not self._lockstep and taken > self._block:
            text = f"the answer took {taken:.2f} s, a block lasts {self._block:g} s: commands come late"
            self._tell(answered, Answer(Command(), Event.SLOW, text, taken))

    def _publish(self, answered: Excitation, command: Command) -> None:
        message = CeilingCommand(**vars(command))
        message.header, message.handshake = answered.header, answered.handshake
        self._commands.publish(message)

    def _tell(self, answered: Excitation, answer: Answer) -> None:
        self._events.publish(answer.severity, answer.kind, answer.text, answer.value, answered.header.stamp)

    def _on_select(self, request: SelectHeight.Request, response: SelectHeight.Response) -> SelectHeight.Response:
        """Answer for the amplitude asked about or, where it is 0 or NaN, for the latest steady estimate."""
        try:
            return select_height(self._selector, request, response, self._latest, self._height)
        except SelectionError as error:
            return refused(self._selector.method, str(error), response)

    def _stay_alone(self) -> None:
        try:
            check_alone(self)
        except StartedTwiceError as error:
            self.get_logger().error(str(error))
            self._alone_timer.cancel()
            if self._latest is None and not self.done.done():
                # nothing commanded yet: the newcomer goes, the one that works stays
                self.done.set_result(BAD_INPUT)

    def close(self) -> None:
        """Stop the timer; the motor notices the silence by itself."""
        self._maps.close()
        if self._search:
            self._search.close()
        self._alone_timer.cancel()


def main(args: Sequence[str] | None = None) -> int:
    """Run the selector as a process of its own; return the exit status."""
    return run_node(SelectorNode, args)


if __name__ == "__main__":
    sys.exit(main())
