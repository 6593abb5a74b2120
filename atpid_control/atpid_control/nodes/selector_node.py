# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Answers each excitation estimate with one ceiling command, and selects heights on request."""

import gc
import math
import sys
import time
from concurrent.futures import Future as Computed
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from atpid_interfaces.msg import CeilingCommand, CeilingState, Event, Excitation
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future

from atpid_common.errors import BAD_INPUT, AtpidError
from atpid_common.latency import Latencies
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, STATES, STEADY, nanoseconds_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import LiveParameters
from atpid_common.nodes.single_instance import started_twice
from atpid_common.nodes.supervision import MISSING, NodeMonitors
from atpid_common.parameters import Value
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import Frame
from atpid_common.waiting import COMPILING, announced
from atpid_control import selection
from atpid_control.identification import Estimate, Quality
from atpid_control.loop.controller import ControlSettings
from atpid_control.loop.protocol import HeightCommand, InlineExecutor, LoopAnswer, threaded
from atpid_control.loop.settings import control_settings, controller_of, selector_of
from atpid_control.nodes.action_servers import MapServer, SearchServer
from atpid_control.nodes.height_services import HeightServices
from atpid_control.nodes.parameter_tables import selector_table
from atpid_control.selection import HeightSelector, SelectionError
from atpid_control.selection.checks import Resonance
from atpid_sim.nodes.messages import scene_given

#: A command answers each block; a gap this long: controller or sensors have stopped [s].
_COMMAND_DEADLINE = 0.5
HELD, _SET = "held by the operator", "set by the operator"
#: A method's selector, and what looks heights up in its place where it fails.
_Made = tuple[HeightSelector, HeightSelector | None]
_ESTIMATES, _STATE, _COMMANDS = "excitation", "ceiling/state", "ceiling/command"


class SelectorNode(Node):
    """Parameters, topics, services, and one call into the controller for each estimate."""

    def __init__(self, **node_options: object) -> None:
        """Read scene and map; raise an AtpidError where they, or parameters, do not fit. `done`: exit status."""
        super().__init__("selector_node", **node_options)
        self.parameters = LiveParameters(self, selector_table())
        self._scene = scene_given(self)
        self._block, self._lockstep = self._scene.recording.block, bool(self.parameters["lockstep"])
        self._method = self.parameters["method"] or self._scene.ceiling.controller or "fixed"
        # selections for the loop and on request run in executors of their own
        self._loop_executor, self._request_executor = (
            InlineExecutor() if self._lockstep else threaded(name) for name in ("loop-selection", "requested-selection")
        )
        with announced(COMPILING, self.get_logger().info):
            self._selector, fallback = self._made_for(self._method)
            self._controller = controller_of(
                self.parameters.__getitem__, self._scene, self._selector, self._loop_executor, fallback
            )
        self._making: tuple[str, Computed[_Made]] | None = None  # of another method
        if not self._lockstep:
            # what lives as long as the node is not looked through again: that may take longer than a selection
            gc.collect()
            gc.freeze()
        self.done: Future = Future()
        self._latest: Estimate | None = None
        self._start_ns: int | None = None
        self._height = math.nan
        self._answer = LoopAnswer(HeightCommand(method=self._method))
        self._refusal = self._refused_reason = ""
        self._latencies = Latencies()
        self._make_topics()
        self._serve()
        self.parameters.follow(self._settings, self._configure, self._events.publish)

    def _make_selector(self, method: str) -> HeightSelector:
        given = self.parameters["map"]
        height_map = Path(given) if given else self._scene.ceiling.map
        return selector_of(self.parameters.__getitem__, method, self._scene, height_map, lockstep=self._lockstep)

    def _made_for(self, method: str) -> _Made:
        """Return the selector of a method and, where it simulates and there is a map, what looks heights up instead."""
        scene, selector = self._scene, self._make_selector(method)
        if not scene.ceiling.controlled:
            return selector, None
        # warm-up call: a method that simulates loads its kernels now, not while the structure vibrates
        with suppress(SelectionError):
            selector.select(selection.Excitation(scene.grain.radius, frequency=scene.frequency_hz))
        given = self.parameters["map"] or scene.ceiling.map
        return selector, self._make_selector("lookup") if selector.simulates and given else None

    def _make_topics(self) -> None:
        self._events = EventPublisher(self)
        timeout = self.parameters["stale_timeout"]
        self._supervision = NodeMonitors(
            self, self._events.publish, self._statuses, timeout, self._on_silence, enabled=not self._lockstep
        )
        stale, qos = self._supervision.stale, self._supervision.qos
        stale.watch(_ESTIMATES, "the ceiling is not controlled")
        stale.watch(_STATE, "whether the ceiling follows its commands is not known")
        profile = BLOCKS  # in lockstep the run does not wait for the recorder, which may be many commands behind
        if not self._lockstep:
            profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
            profile.deadline = Duration(seconds=max(_COMMAND_DEADLINE, MISSING * self._block))
        self._commands = self.create_publisher(
            CeilingCommand,
            _COMMANDS,
            profile,
            event_callbacks=qos.publisher(_COMMANDS, deadline_counts=lambda: stale.running),
        )
        # before the estimates: a rumble is published before the estimate of the same block
        subscribe(self, Event, "events", self._on_event, STATES)
        subscribe(
            self, Excitation, _ESTIMATES, self._on_excitation, STATES, event_callbacks=qos.subscription(_ESTIMATES)
        )
        subscribe(self, CeilingState, _STATE, self._on_state, STATES, event_callbacks=qos.subscription(_STATE))

    def _serve(self) -> None:
        self._height_services = HeightServices(
            self, self._request_executor, self._make_selector, self._method, self._situation, self._scene
        )
        self._maps = MapServer(self)
        # a ceiling that no controller moves cannot be searched
        mode = self._controller.search
        self._search = SearchServer(self, mode, lambda: self._start_ns) if mode else None
        self._alone_timer = self.create_timer(1.0, self._check_alone, clock=STEADY)

    # parameters that change while the node runs

    def _settings(self, value: Value) -> tuple[ControlSettings, float]:
        if value("method") not in ("", self._method) and not self._scene.ceiling.controlled:
            raise SelectionError("method: the scene moves the ceiling; allowed: a scene whose ceiling has a controller")
        return control_settings(value, self._scene.frequency_hz, self._selector), float(value("stale_timeout"))

    def _configure(self, settings: tuple[ControlSettings, float]) -> None:
        self._controller.configure(settings[0])
        self._supervision.stale.timeout = settings[1]
        # another method that was chosen is made beside the loop, which goes on by the last one
        wanted = self.parameters["method"] or self._scene.ceiling.controller or self._method
        if self._making is None and wanted != self._method:
            self._making = wanted, self._request_executor.submit(self._made_for, wanted)

    def _take_another(self) -> None:
        """Select by another method once it is made; one that cannot be made is refused, and the last one goes on."""
        if self._making is None or not self._making[1].done():
            return
        (method, made), self._making = self._making, None
        try:
            selector, fallback = made.result()
        except AtpidError as error:
            text = f"{error}; heights are still selected by {self._method}"
            self._events.publish(Event.WARNING, Event.REFUSED, text)
            return
        self._selector, self._method = selector, method
        self._height_services.method = method
        settings = self._settings(self.parameters.__getitem__)
        self._controller.select_by(settings[0], selector, fallback)
        self._events.publish(Event.INFO, Event.PARAMETER, f"heights are selected by {method}")
        self._configure(settings)

    # the loop

    def _on_state(self, state: CeilingState) -> None:
        if not state.handshake:
            self._supervision.stale.received(_STATE)
        self._height = state.height

    def _on_event(self, event: Event) -> None:
        self._supervision.on_event(event)
        if event.node != self.get_name():
            self._controller.on_event(event.kind)

    def _on_excitation(self, message: Excitation) -> None:
        if message.handshake:
            self._publish(message, HeightCommand(reason="handshake"))
            return
        now = nanoseconds_of(message.header.stamp)
        self._supervision.stale.received(_ESTIMATES, now, self._block)
        if self._start_ns is None:
            # the first stamp is that of the first block's last sample
            self._start_ns = now - round(self._block * 1e9)
        estimate = Estimate(
            quality=Quality(message.quality),
            amplitude=message.amplitude,
            amplitude_std=message.amplitude_std,
            frequency=message.frequency,
            frequency_std=message.frequency_std,
            beam_amplitude=message.beam_amplitude,
        )
        if estimate.quality == Quality.STEADY:
            self._latest = estimate
        begun = time.monotonic()
        self._take_another()
        self._answer = self._controller.answer((now - self._start_ns) * 1e-9, estimate, self._height)
        self._publish(message, self._answer.command)
        self._latencies.add(self.get_clock().now().nanoseconds - now)
        if self._search:
            self._search.report()
        if self._answer.kind:
            answer = self._answer
            self._events.publish(answer.severity, answer.kind, answer.text, answer.value, message.header.stamp)
        self._follow_refusal()
        taken = time.monotonic() - begun
        if not self._lockstep and taken > self._block:  # in lockstep the loop waits for it
            text = f"the answer took {taken:.2f} s, a block lasts {self._block:g} s: commands come late"
            self._events.publish(Event.WARNING, Event.SLOW, text, taken, message.header.stamp)

    def _publish(self, answered: Excitation, command: HeightCommand) -> None:
        if self.parameters["hold"] and not answered.handshake:
            command = replace(command, height=math.nan, reason=HELD)
        elif not answered.handshake and (manual := self.parameters["manual_height"]):
            command = replace(command, height=manual, method="manual", reason=_SET)
        message = CeilingCommand(**vars(command))
        message.header.stamp, message.header.frame_id = answered.header.stamp, Frame.CEILING
        message.handshake = answered.handshake
        self._commands.publish(message)

    # services

    def _situation(self) -> tuple[Estimate | None, float, Resonance]:
        tolerance = float(self.parameters["frequency_tolerance"])
        return self._latest, self._height, Resonance(self._scene.frequency_hz, tolerance)

    # diagnostics

    def _on_silence(self) -> None:
        stale = self._supervision.stale.stale
        if _STATE in stale:
            self._height = math.nan
        if stale and self._search:
            self._search.stop(f"no messages on {', '.join(stale)}")

    def _follow_refusal(self) -> None:
        """Hold the text of a refusal, which the controller reports once, while its reason holds."""
        if self._answer.kind == Event.REFUSED:
            self._refusal, self._refused_reason = self._answer.text, self._answer.command.reason
        elif self._refusal and self._answer.command.reason != self._refused_reason:
            self._refusal = ""

    def _statuses(self) -> list[DiagnosticStatus]:
        command = self._answer.command
        excitation = f"excitation amplitude [{self._scene.driven_by.unit}]"
        values = {"method": command.method, "reason": command.reason, "height [m]": command.height}
        values |= {excitation: command.excitation_amplitude, "predicted amplitude [m]": command.predicted_amplitude}
        level = DiagnosticStatus.WARN if self._refusal else DiagnosticStatus.OK
        values |= self._latencies.values("sample to command")
        return [status(self, "height selection", level, self._refusal or command.reason, values)]

    # the end

    def _check_alone(self) -> None:
        if started_twice(self):
            self._alone_timer.cancel()
            if self._latest is None and not self.done.done():
                # nothing commanded yet: this node ends, the other one goes on
                self.done.set_result(BAD_INPUT)

    def close(self) -> None:
        """Stop timers and computations; the motor holds the ceiling without commands."""
        self._supervision.close()
        self._maps.close()
        if self._search:
            self._search.close()
        for executor in (self._loop_executor, self._request_executor):
            executor.shutdown(cancel_futures=True)
        self._alone_timer.cancel()


main = partial(run_node, SelectorNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
