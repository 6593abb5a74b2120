# SPDX-License-Identifier: Apache-2.0
"""Answers each block of samples with one estimate of the excitation."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from atpid_interfaces.msg import CeilingState, Event, Excitation, SampleBlock
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.single_instance import StartedTwiceError, check_alone
from atpid_common.waiting import COMPILING, announced
from atpid_control.identification import Estimate, IdentificationError, Identifier, Quality, warm_up
from atpid_control.nodes.identifier_parameters import declare, inverse_of, rumble_of, settings_of, text_of
from atpid_control.watch import RumbleState, RumbleWatch
from atpid_sim.stream import stamp_ns

BAD_INPUT = 2


class IdentifierNode(Node):
    """Parameters, topics, and one call into the identification for each block."""

    def __init__(self, *, parameter_overrides: list[Parameter] | None = None, **node_options: Any) -> None:
        """Raise IdentificationError or SceneError, in one line, where parameters do not fit. `done`: exit status."""
        super().__init__("identifier_node", parameter_overrides=parameter_overrides, **node_options)
        declare(self)
        self._names = (text_of(self, "support_channel"), text_of(self, "beam_channel"))
        inverse = inverse_of(self)
        self.identifier = Identifier(settings_of(self), inverse)
        with announced(COMPILING, self.get_logger().info):
            warm_up()
        self._rumble = RumbleWatch(rumble_of(self))
        self.done: Future = Future()
        self._height = math.nan
        self._status = _Status()
        self.complaint = ""  # what was last wrong with a block, one sentence
        self._excitation = self.create_publisher(Excitation, "excitation", EVENTS)
        self._events = EventPublisher(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self.create_subscription(SampleBlock, "sensors/laser", self._on_block, BLOCKS)
        if inverse is not None:
            self.create_subscription(CeilingState, "ceiling/state", self._on_state, STATES)
        self._each_second = self.create_timer(1.0, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_state(self, state: CeilingState) -> None:
        self._height = state.height

    def _on_block(self, block: SampleBlock) -> None:
        if block.handshake:
            self._excitation.publish(Excitation(header=block.header, handshake=True, **_fields(Estimate())))
            return
        last_ns = last_stamp(block)
        try:
            estimate = self._identify(block, last_ns)
        except IdentificationError as error:
            self._complain(str(error))
            estimate = Estimate()
        message = Excitation(**_fields(estimate))
        message.header.stamp, message.header.frame_id = time_of(last_ns), block.header.frame_id
        # before the estimate, so that whoever answers it has heard of the rumble
        self._watch(block, estimate, message)
        self._tell_change(estimate, message)
        self._excitation.publish(message)
        self._status.note(block, estimate)

    def _identify(self, block: SampleBlock, last_ns: int) -> Estimate:
        channels = list(block.channels)
        support, beam = (channel_of(block, name) for name in self._names)
        source = self._names[self.identifier.source]
        if source not in channels:
            raise IdentificationError(
                f"{source}: given channels {', '.join(channels) or 'none'}; set support_channel or beam_channel to one"
            )
        delay = block.skew[channels.index(source)] if len(block.skew) == len(channels) else 0.0
        return self.identifier.push(
            block.first_index, block.rate, support, beam, last_ns * 1e-9, delay=delay, height=self._height
        )

    def _watch(self, block: SampleBlock, estimate: Estimate, message: Excitation) -> None:
        """Say when the beam begins to rumble, and when it is calm again."""
        beam = channel_of(block, self._names[1])
        if beam is None:
            return
        before = self._rumble.state
        after = self._rumble.push(block.first_index, block.rate, beam, estimate.frequency)
        if after.rumbling != before.rumbling:
            self._tell(*_rumble_event(after), message)

    def _complain(self, text: str) -> None:
        if text != self.complaint:
            self.get_logger().error(text)
        self.complaint = text

    def _tell_change(self, estimate: Estimate, message: Excitation) -> None:
        """Say a change once, when it has become steady again: then its size is known."""
        if estimate.changed and estimate.quality == Quality.STEADY:
            text = f"excitation is now {estimate.amplitude:.5f} m at {estimate.frequency:.3f} Hz"
            self._tell(Event.INFO, Event.EXCITATION_CHANGED, estimate.amplitude, text, message)

    def _tell(self, severity: int, kind: str, value: float, text: str, message: Excitation) -> None:
        self._events.publish(severity, kind, text, value, message.header.stamp)

    def _report(self) -> None:
        """Publish diagnostics, and leave where another node of this name works already."""
        array = DiagnosticArray(status=[self._status.message(self.get_name())])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        try:
            check_alone(self)
        except StartedTwiceError as error:
            self.get_logger().error(str(error))
            if self._status.blocks == 0 and not self.done.done():
                self.done.set_result(BAD_INPUT)

    def close(self) -> None:
        """Stop the timer."""
        self._each_second.cancel()


class _Status:
    """What diagnostics say: blocks answered, and what was lost on the way."""

    def __init__(self) -> None:
        self.blocks = 0
        self._missing = 0
        self._expected: int | None = None
        self._rate = math.nan
        self._latest = Estimate()

    def note(self, block: SampleBlock, estimate: Estimate) -> None:
        scans = len(block.data) // max(len(block.channels), 1)
        if self._expected is not None and block.first_index > self._expected:
            self._missing += block.first_index - self._expected
        self._expected = block.first_index + scans
        self.blocks += 1
        self._rate, self._latest = block.rate, estimate

    def message(self, name: str) -> DiagnosticStatus:
        poor = self._latest.quality == Quality.POOR
        values = {"blocks": self.blocks, "rate [Hz]": self._rate, "missing scans": self._missing,
                  "quality": self._latest.quality.name, "amplitude [m]": self._latest.amplitude,
                  "frequency [Hz]": self._latest.frequency}  # fmt: skip
        return DiagnosticStatus(
            level=DiagnosticStatus.WARN if poor else DiagnosticStatus.OK,
            name=name,
            message="poor estimate" if poor else "identifying" if self.blocks else "waiting for samples",
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def channel_of(block: SampleBlock, name: str) -> NDArray[np.float64] | None:
    """Return one channel of a block (n_scans,), None where the block has none of that name."""
    channels = list(block.channels)
    if name not in channels:
        return None
    data: NDArray[np.float64] = np.frombuffer(block.data, dtype=np.float64)
    return data.reshape(-1, len(channels))[:, channels.index(name)]


def last_stamp(block: SampleBlock) -> int:
    """Return when the block's last scan was taken [ns]: the stream's start plus index over rate, rounded once."""
    begin = nanoseconds_of(block.header.stamp)
    scans = len(block.data) // max(len(block.channels), 1)
    if scans == 0 or not block.rate > 0.0:
        return begin
    start = begin - stamp_ns(0, block.first_index, block.rate)
    return stamp_ns(start, block.first_index + scans - 1, block.rate)


def _rumble_event(state: RumbleState) -> tuple[int, str, float, str]:
    """Return severity, kind, value and text of a rumble's beginning or end."""
    if not state.rumbling:
        return Event.INFO, Event.CALM, state.scatter, "the beam's response is regular again"
    text = f"the beam's amplitude scatters by {state.scatter:.1%} from period to period at {state.amplitude:.4f} m"
    return Event.WARNING, Event.RUMBLE, state.scatter, text


#: What an estimate holds and the message does not.
_NOT_SAID = ("time", "growth", "growth_std")


def _fields(estimate: Estimate) -> dict[str, Any]:
    """Return the estimate as the message's fields."""
    fields = {name: value for name, value in vars(estimate).items() if name not in _NOT_SAID}
    return fields | {"quality": int(estimate.quality), "origin": int(estimate.origin)}


def main(args: Sequence[str] | None = None) -> int:
    """Run the identifier as a process of its own; return the exit status."""
    return run_node(IdentifierNode, args)


if __name__ == "__main__":
    sys.exit(main())
