# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the supervisor judges of the graph's messages: the loop check, and the limited quantities.

The loop check is made once, soon after the first sample, and on request.
"""

from collections.abc import Callable

from atpid_interfaces.msg import RecorderStatus, SampleBlock
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.handshake import Question
from atpid_common.nodes.messages import STATES, STATUS, channels_of
from atpid_control.supervision.limits import AbortLevels, ContactRate, OnTime, Passed, largest, sustained
from atpid_control.supervision.loop_check import Ceiling, LoopSnapshot, failures
from atpid_sim.scene import load_scene

_LIMITS = ["lowest", "highest", "speed"]


class LoopChecker:
    """Collects what the check compares; `failures` returns what fails now."""

    def __init__(self, node: Node, nodes: tuple[str, ...], scene: str, allowed: float) -> None:
        """Subscribe; scene: file, empty: its limits are not compared; allowed: until all has to be right [s], 0: ever.

        Raises SceneError.
        """
        self._allowed, self._known = allowed, LoopSnapshot(recorder_expected="recorder_node" in nodes)
        ceiling = load_scene(scene).ceiling if scene else None
        if ceiling is not None and ceiling.controlled and "motor_node" in nodes:
            self._known.scene = Ceiling(*ceiling.range, ceiling.speed)
        self._channels: set[str] = set()
        self._begun: float | None = None
        self.decided = allowed == 0.0
        self._limits = Question(node.create_client(GetParameters, "motor_node/get_parameters"), self._on_limits)
        subscribe(node, RecorderStatus, "recorder/status", self._on_recorder, STATUS)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, STATES)

    def on_block(self, block: SampleBlock, now: float) -> None:
        """Take a block of samples received at the steady time `now` [s]."""
        self._begun = self._begun or now
        for channel, values in channels_of(block).items():
            self._channels.add(channel)
            self._known.sensors.push(channel, values, now)

    def turn(self, now: float) -> list[str]:
        """Go on at the steady time `now` [s]; return what fails still when the time allowed is over."""
        if self._known.scene is not None and self._known.motor is None:
            self._limits.ask(GetParameters.Request(names=_LIMITS), now)
        if self.decided or self._begun is None:
            return []
        found = self.failures(now)
        self.decided = not found or now - self._begun > self._allowed  # it is made once
        return found if self.decided else []

    def failures(self, now: float) -> list[str]:
        """Return what fails at the steady time `now` [s], one line each."""
        return failures(self._known, now)

    def _on_limits(self, answer: GetParameters.Response) -> None:
        values = [value.double_value for value in answer.values]
        self._known.motor = Ceiling(*values) if len(values) == len(_LIMITS) else self._known.motor

    def _on_recorder(self, status: RecorderStatus) -> None:
        self._known.recording, self._known.written = status.recording, sum(status.written)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        """Keep what a source's watch reports of a channel: dead, frozen, clipped."""
        for status in array.status:
            channel = status.name.rsplit(": ", 1)[-1]
            if channel not in self._channels:
                continue
            if status.level == DiagnosticStatus.ERROR:
                self._known.errors[channel] = status.message
            else:
                self._known.errors.pop(channel, None)


#: Channels that change smoothly, so that a lone sample beyond a level is a spike of the sensor.
_SMOOTH = ("support_displacement", "drive_force", "beam_displacement", "temperature")
_ACCELERATION = "beam_acceleration"


class QuantityWatch:
    """Compares the quantities of blocks and motor states with their levels."""

    def __init__(self, limits: AbortLevels, contact: tuple[float, float], on_passed: Callable[[Passed], None]) -> None:
        """Take the levels; contact: threshold [m/s^2] and dead time [s]; on_passed: called with each level passed."""
        self.limits, self._on_passed = limits, on_passed
        self._contacts, self._on_time = ContactRate(*contact), OnTime()
        self._latest: dict[str, float] = {}

    def on_block(self, block: SampleBlock, now: float) -> None:
        """Take a block of samples received at the steady time `now` [s]."""
        for name, values in channels_of(block).items():
            if self.limits.limited(name):
                self._take(name, sustained(values) if name in _SMOOTH else largest(values), now)
            if name == _ACCELERATION and self.limits.limited("contact_rate"):
                self._take("contact_rate", self._contacts.push(block.first_index, block.rate, values), now)

    def on_motor(self, on: bool, now: float) -> None:
        """Take whether the motor's current is on at the steady time `now` [s]."""
        self._take("motor_on_time", self._on_time.push(on, now), now)

    def still_above(self) -> tuple[str, ...]:
        """Return the aborted quantities that are above their abort level still."""
        return self.limits.still_above(self._latest)

    def values(self) -> dict[str, object]:
        """Return the latest of each quantity that is limited, for diagnostics."""
        return {name: f"{value:.4g}" for name, value in self._latest.items()}

    def _take(self, name: str, value: float, now: float) -> None:
        self._latest[name] = value
        passed = self.limits.update(name, value, now)
        if passed is not None:
            self._on_passed(passed)
