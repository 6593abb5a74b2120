# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The acquisition node: a lifecycle node around one `Acquisition` device, whichever backend it is.

configure opens the device and checks its identity; activate does the handshake and streams; deactivate stops the
stream. `labjack_node` and `ni_node` are two uses of it, with a backend and a topic by default.
The device's calls block in the Reader's thread; only the executor's thread publishes.
"""

import array
import queue
import sys
from collections.abc import Mapping
from functools import partial
from typing import ClassVar

from atpid_interfaces.msg import CeilingState, Event, RecorderStatus, SampleBlock
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.lifecycle import TransitionCallbackReturn

from atpid_common.errors import InputError
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.handshake import LOOP_TOPICS, Handshake, empty_block
from atpid_common.nodes.messages import BLOCKS, STATES, STEADY, doubles, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.recorder_watch import RecorderWatch
from atpid_common.real_time import LOOP_PRIORITY
from atpid_driver.acquisition import DeviceIdentity
from atpid_driver.acquisition.reader import Backoff, Reader, Status
from atpid_driver.acquisition.registry import create
from atpid_driver.acquisition.topic import TopicAcquisition
from atpid_driver.calibration.model import block_si
from atpid_driver.nodes.acquisition_parameters import settings_of
from atpid_driver.nodes.channel_watch import ChannelWatch
from atpid_driver.nodes.device_node import DeviceNode
from atpid_driver.nodes.topic_source import subscribe_source


class AcquisitionNode(DeviceNode):
    """Publishes what one device measures, in SI units, on one topic. Raises InputError for an invalid one."""

    NAME: ClassVar[str] = "acquisition_node"
    #: Its own defaults of parameters, by name.
    USUAL: ClassVar[Mapping[str, object]] = {}

    def __init__(self, **kwargs: object) -> None:
        super().__init__(self.NAME, **kwargs)
        try:
            self._settings, self._calibrations = settings_of(self, self.USUAL)
            self._device = create(self._settings["backend"], self._settings)
            if isinstance(self._device, TopicAcquisition):
                subscribe_source(self, self._device)
        except InputError:
            self.leave_graph()
            raise
        self._blocks = self.create_publisher(SampleBlock, self._settings["topic"], BLOCKS)
        self._events = EventPublisher(self)
        if self._settings["in_loop"]:
            subscribe(self, CeilingState, "ceiling/state", self._on_state, STATES)
        expected = self._settings["expect_recorder"]
        self._recorder = RecorderWatch(self, self._on_recorder, self._events.publish, expected=expected)
        self._identity: DeviceIdentity | None = None
        self._reader: Reader | None = None
        self._handshake: Handshake | None = None
        self._units = [calibration.unit for calibration in self._calibrations]
        self._message: SampleBlock | None = None  # published again and again, with other samples; None: nothing yet
        self._reports: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()
        self._channels = ChannelWatch(self, self._calibrations, self._settings, self._events.publish)
        self._last_dropped, self._lost_lately, self._closing = 0, 0, False
        self._arrived = self.create_guard_condition(self._drain)
        self.create_timer(1.0, self._each_second, clock=STEADY)
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)
        self._attempts, self._backoff = 0, Backoff()
        if self._settings["autostart"]:
            self._starter = self.create_timer(0.01, self._start, clock=STEADY)

    def _configure(self) -> None:
        self._identity = self._device.open()
        self.get_logger().info(f"connected to {self._identity}: {', '.join(self._device.channels)}")

    def _activate(self) -> None:
        settings = self._settings
        if not settings["handshake"]:
            self._stream()
            return
        self._handshake = Handshake(
            self,
            self._publish_handshake,
            self._stream,
            topics=(settings["topic"], *(LOOP_TOPICS if settings["in_loop"] else ())),
            answer="ceiling/state" if settings["in_loop"] else "",
            recorder=settings["expect_recorder"],
        )
        if self._recorder.status is not None:
            self._handshake.on_status(self._recorder.status)

    def _deactivate(self) -> None:
        handshake, self._handshake = self._handshake, None
        if handshake is not None:
            handshake.cancel()
        if self._reader is not None:
            self._reader.stop()
            self._drain()
            scans, lost = self._reader.status.next_index, self._reader.status.dropped
            self.get_logger().info(f"{self._identity}: stream stopped after {scans} scans, {lost} of them lost")
            self._reader = None

    def _release(self) -> None:
        self._deactivate()
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

    def _on_state(self, state: CeilingState) -> None:
        if self._handshake is not None:
            self._handshake.on_answer(state)

    def _on_recorder(self, status: RecorderStatus) -> None:
        if self._handshake is not None:
            self._handshake.on_status(status)

    def _publish_handshake(self) -> None:
        self._blocks.publish(empty_block(self._device.channels, self._units))
        self._events.publish_handshake()

    def _stream(self) -> None:
        assert self._identity is not None
        self._handshake, self._message, self._last_dropped = None, None, 0
        self._channels.begin()
        self._reader = Reader(self._device, self._identity, self._wake, lambda *report: self._reports.put(report))
        self._reader.start()

    def _wake(self) -> None:
        """Trigger the executor from the reader's thread: there is something to take."""
        if not self._closing and self.context.ok():
            self._arrived.trigger()

    def _drain(self) -> None:
        reader = self._reader
        if reader is None or not self.context.ok():  # an interrupt shuts the context down before the node
            return
        for block in reader.take():
            assert reader.rate is not None
            values, counts = block_si(self._calibrations, block.volts)
            if self._channels.take(block.volts, values, counts, reader.rate):
                self._diagnostics.publish()
            stamp = time_of(block.stamp_ns)
            message = self._message = self._message or self._first_message(reader.rate, stamp)
            message.header.stamp, message.data = stamp, doubles(values)
            message.first_index, message.dropped, message.backlog = block.first_index, block.dropped, block.backlog
            self._blocks.publish(message)
        while not self._reports.empty():
            fault, text = self._reports.get()
            kind = (Event.ALARM, Event.FAULT) if fault else (Event.INFO, Event.RECOVERED)
            self._events.publish(*kind, text)

    def _first_message(self, rate: float, stamp: Time) -> SampleBlock:
        """Report the start of the stream; return a message with what does not change from block to block."""
        channels, skew = self._device.channels, array.array("d", self._device.skew())
        text = f"{self._identity} streams {len(channels)} channels at {rate:g} Hz"
        self._events.publish(Event.INFO, Event.STARTED, text, stamp=stamp)
        message = SampleBlock(rate=rate, channels=list(channels), units=self._units, skew=skew)
        message.header.frame_id, message.device = self._settings["frame_id"], str(self._identity)
        return message

    @property
    def status(self) -> Status:
        """State of the stream; all zero while there is none."""
        return self._reader.status if self._reader is not None else Status()

    def _each_second(self) -> None:
        dropped = self.status.dropped
        self._lost_lately, self._last_dropped = max(0, dropped - self._last_dropped), dropped
        if self._lost_lately:
            text = f"{self._identity}: {self._lost_lately} scans lost, {dropped} in all"
            self._events.publish(Event.WARNING, Event.DROPPED, text, float(self._lost_lately))

    def _statuses(self) -> list[DiagnosticStatus]:
        state, status = self._state_text(), self.status
        last_error = self._last_error or status.last_error
        level, message = DiagnosticStatus.OK, f"streaming at {status.rate:g} Hz" if status.streaming else state
        if last_error:
            level, message = DiagnosticStatus.ERROR, last_error
        elif self._lost_lately:
            level, message = DiagnosticStatus.WARN, f"{self._lost_lately} scans lost in the last second"
        values: dict[str, object] = {
            "state": state,
            "rate [Hz]": f"{status.rate:.6f}",
            "next index": status.next_index,
            "backlog [scans]": status.backlog,
            "queued [blocks]": status.queued,
            "dropped [scans]": status.dropped,
            "late [scans]": getattr(self._device, "late", 0),
            "interruptions": status.interruptions,
            "clock drift [ppm]": f"{status.drift_ppm:.2f}",
            "clock offset [s]": f"{status.offset_s:.6f}",
            "stamps, standard deviation [s]": f"{status.error_s:.2g}",
            "last error": last_error or "none",
        }
        serial = str(self._identity.serial) if self._identity else "none"
        channels = self._channels.statuses(serial) if status.streaming else []
        return [diagnostic_status(self, "acquisition", level, message, values, serial), *channels]

    def _state_text(self) -> str:
        if self._identity is None:
            return "no device"
        if self._handshake is not None:
            return f"waiting for {self._handshake.waiting_for() or 'nothing'}"
        if self._reader is None:
            return "connected"
        return "streaming" if self._reader.status.streaming else "interrupted"

    def _report(self, text: str) -> None:
        self._events.publish(Event.ALARM, Event.FAULT, text)

    def destroy_node(self) -> None:
        """Stop the stream, release the device, then end the node."""
        self._closing = True
        super().destroy_node()


main = partial(run_node, AcquisitionNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
