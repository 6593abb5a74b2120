# SPDX-License-Identifier: Apache-2.0
"""What the LabJack and the NI node share: a lifecycle node around one `Acquisition` device.

configure opens the device and checks who it is; activate shakes hands and streams; deactivate stops the stream.
The device's calls block in the Reader's thread; only the executor's thread publishes.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from typing import Any

from atpid_interfaces.msg import CeilingState, Event, RecorderStatus, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.handshake import LOOP_TOPICS, Handshake, empty_block
from atpid_common.nodes.lifecycle_node import EnduringLifecycleNode
from atpid_common.nodes.messages import BLOCKS, STATES, time_of
from atpid_common.nodes.parameters import Row
from atpid_common.nodes.recorder_watch import RecorderWatch
from atpid_driver.acquisition import AcquisitionError, Backoff, Identity, Reader, Status, create
from atpid_driver.calibration import Counts, block_si
from atpid_driver.nodes.acquisition_diagnostics import status_message
from atpid_driver.nodes.acquisition_parameters import settings_of
from atpid_driver.nodes.blocks import Layout, sample_block

STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class AcquisitionNode(EnduringLifecycleNode):
    """Publishes what one device measures, in SI units, on one topic. An InputError for a parameter that cannot be."""

    def __init__(self, name: str, topic: str, rows: tuple[Row, ...], *, in_loop: bool, **kwargs: Any) -> None:
        """Declare parameters and topics; nothing is opened. `in_loop`: the loop answers this topic's handshake."""
        super().__init__(name, **kwargs)
        self.settings = settings_of(self, rows)
        self._device = create(self.settings.backend, self.settings.device)
        self._topic, self._in_loop = topic, in_loop
        self._blocks = self.create_publisher(SampleBlock, topic, BLOCKS)
        self._events = EventPublisher(self)
        if in_loop:
            self.create_subscription(CeilingState, "ceiling/state", self._on_state, STATES)
        expected = self.settings.expect_recorder
        self._recorder = RecorderWatch(self, self._on_recorder, self._events.publish, expected=expected)
        self._identity: Identity | None = None
        self._reader: Reader | None = None
        self._handshake: Handshake | None = None
        self._layout: Layout | None = None
        self._reports: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()
        self._counts: dict[str, Counts] = {name: Counts() for name in self._device.channels}
        self._last_dropped, self._lost_lately, self._last_error, self._closing = 0, 0, "", False
        self._arrived = self.create_guard_condition(self._drain)
        self.create_timer(1.0, self._each_second, clock=STEADY)
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)
        self._attempts, self._backoff, self._may_retry = 0, Backoff(), True
        self._starter: Timer | None = None
        if self.settings.autostart:
            self._starter = self.create_timer(0.01, self._start, clock=STEADY)

    # -- lifecycle -------------------------------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the device and check its serial number."""
        return self._transition("configure", self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shake hands, then stream."""
        return self._transition("activate", self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the stream; the device stays open."""
        return self._transition("deactivate", self._halt)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the device."""
        return self._transition("clean up", self._let_go)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let go of the device from any state."""
        self._end_starting()
        return self._transition("shut down", self._let_go)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to unconfigured, alive, so that it can be configured again."""
        self._transition("let go", self._let_go)
        return TransitionCallbackReturn.SUCCESS

    def _transition(self, verb: str, act: Callable[[], None]) -> TransitionCallbackReturn:
        """Do `act`; what the device refuses fails the transition, what breaks is an error; both are logged once."""
        try:
            act()
        except AcquisitionError as error:
            self._complain(f"cannot {verb}: {error}")
            self._may_retry = error.retry
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # rclpy drops exceptions of transitions without a word
            self._complain(f"cannot {verb}: {type(error).__name__}: {error}")
            self._may_retry = False
            return TransitionCallbackReturn.ERROR
        self._last_error = ""
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        self._identity = self._device.open()
        self.get_logger().info(f"connected to {self._identity}: {', '.join(self._device.channels)}")

    def _activate(self) -> None:
        if not self.settings.handshake:
            self._stream()
            return
        self._handshake = Handshake(
            self,
            self._publish_handshake,
            self._stream,
            topics=(self._topic, *(LOOP_TOPICS if self._in_loop else ())),
            answer="ceiling/state" if self._in_loop else "",
            recorder=self.settings.expect_recorder,
        )
        if self._recorder.status is not None:
            self._handshake.on_status(self._recorder.status)

    def _halt(self) -> None:
        handshake, self._handshake = self._handshake, None
        if handshake is not None:
            handshake.cancel()
        if self._reader is not None:
            self._reader.stop()
            self._drain()
            scans, lost = self._reader.status.next_index, self._reader.status.dropped
            self.get_logger().info(f"{self._identity}: stream stopped after {scans} scans, {lost} of them lost")
            self._reader = None

    def _let_go(self) -> None:
        self._halt()
        self._identity = None
        self._device.close()

    def _start(self) -> None:
        """Configure until the device answers, waiting longer after each attempt, then activate once."""
        assert self._starter is not None
        if self._identity is not None:  # configured by hand meanwhile
            self._end_starting()
        elif self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self._end_starting()
            self.trigger_activate()
        elif self._may_retry:
            self._starter.timer_period_ns = int(self._backoff.delay(self._attempts) * 1e9)
            self._attempts += 1
        else:
            self._end_starting()

    def _end_starting(self) -> None:
        if self._starter is not None:
            self.destroy_timer(self._starter)
            self._starter = None

    # -- the stream ------------------------------------------------------------------------------------------------

    def _on_state(self, state: CeilingState) -> None:
        if self._handshake is not None:
            self._handshake.on_answer(state)

    def _on_recorder(self, status: RecorderStatus) -> None:
        if self._handshake is not None:
            self._handshake.on_status(status)

    def _publish_handshake(self) -> None:
        units = tuple(calibration.unit for calibration in self.settings.calibrations)
        self._blocks.publish(empty_block(self._device.channels, units))
        self._events.publish_handshake()

    def _stream(self) -> None:
        assert self._identity is not None
        self._handshake, self._layout, self._last_dropped = None, None, 0
        self._reader = Reader(self._device, self._identity, self._wake, lambda *report: self._reports.put(report))
        self._reader.start()

    def _wake(self) -> None:
        """Tell the executor from the reader's thread that there is something to take."""
        if not self._closing and self.context.ok():
            self._arrived.trigger()

    def _drain(self) -> None:
        reader = self._reader
        if reader is None or not self.context.ok():  # an interrupt shuts the context down before the node
            return
        for block in reader.take():
            assert reader.clock is not None
            values, counts = block_si(self.settings.calibrations, block.volts)
            for name, count in zip(self._counts, counts, strict=True):
                self._counts[name] += count
            stamp = reader.clock.stamp_ns(block.first_index)
            if self._layout is None:
                self._publish_started(reader.clock.rate, stamp)
            layout = self._layout_at(reader.clock.rate)
            self._blocks.publish(sample_block(layout, stamp, block.first_index, values, block.dropped, block.backlog))
        while not self._reports.empty():
            self._pass_on(*self._reports.get())

    def _publish_started(self, rate: float, stamp_ns: int) -> None:
        text = f"{self._identity} streams {len(self._device.channels)} channels at {rate:g} Hz"
        self._events.publish(Event.INFO, Event.STARTED, text, stamp=time_of(stamp_ns))

    def _layout_at(self, rate: float) -> Layout:
        if self._layout is None:
            units = tuple(calibration.unit for calibration in self.settings.calibrations)
            self._layout = Layout(str(self._identity), rate, self._device.channels, units, self._device.skew())
        return self._layout

    # -- watching --------------------------------------------------------------------------------------------------

    @property
    def status(self) -> Status:
        """How the stream does; all zero while there is none."""
        return self._reader.status if self._reader is not None else Status()

    def _pass_on(self, fault: bool, text: str) -> None:
        self._events.publish(Event.ALARM if fault else Event.INFO, Event.FAULT if fault else Event.RECOVERED, text)

    def _each_second(self) -> None:
        dropped = self.status.dropped
        self._lost_lately, self._last_dropped = max(0, dropped - self._last_dropped), dropped
        if self._lost_lately:
            text = f"{self._identity}: {self._lost_lately} scans lost, {dropped} in all"
            self._events.publish(Event.WARNING, Event.DROPPED, text, float(self._lost_lately))

    def _statuses(self) -> list[DiagnosticStatus]:
        state = self._state_in_words()
        arguments = (self._identity, state, self.status, self._counts, self._lost_lately, self._last_error)
        return [status_message(self, *arguments)]

    def _state_in_words(self) -> str:
        if self._identity is None:
            return "no device"
        if self._handshake is not None:
            return f"waiting for {self._handshake.waiting_for() or 'nothing'}"
        if self._reader is None:
            return "connected"
        return "streaming" if self._reader.status.streaming else "interrupted"

    def _complain(self, text: str) -> None:
        """Log a complaint once, not at every attempt."""
        if text != self._last_error:
            self._events.publish(Event.ALARM, Event.FAULT, text)
        self._last_error = text

    def destroy_node(self) -> None:
        """Stop the stream, let go of the device, then the node's own end."""
        self._closing = True
        self._transition("let go", self._let_go)
        super().destroy_node()
