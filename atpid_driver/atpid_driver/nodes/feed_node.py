# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The wiring of the emulated stand: displacements of a simulated plant become the voltages of a stand-in device.

It subscribes to the plant's sensor topic, remapped to `emulated/...`, and writes a `Feed`. Until the plant starts
and after it has finished it feeds the last displacement at the sensor's rate. The plant's
`ceiling/state` is remapped too: this node republishes the motor's states and answers the plant's handshake, but not
before the real device streams, so that the stand records the run from its first instant. Where a device excites, its
voltage becomes the plant's `emulated/excitation/state`.
"""

import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
from atpid_interfaces.msg import CeilingState, Event, ExcitationState, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from atpid_common.errors import InputError
from atpid_common.files import Document
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_common.nodes.handshake import ANNOUNCE_AFTER, ANNOUNCE_AGAIN, empty
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, STEADY
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.parameters import Entry
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import Frame
from atpid_driver import DriverError
from atpid_driver.calibration.model import calibrations_of, load, si_of, volts_of
from atpid_driver.nodes.acquisition_parameters import check_topic
from atpid_driver.standins import Feed
from atpid_driver.standins.device import FEED_MAGIC, Outputs

#: Between two states; what is looked at for each [s].
_PERIOD, _WINDOW = 0.05, 0.06
#: A tone below this share of the range is none.
_NOISE = 1e-4


class _EmulatedExciter:
    """Publishes emulated/excitation/state: what DAC0, of a shaker over DAC1, really does, whatever the node says."""

    def __init__(self, node: Node, values: Document, topic: str) -> None:
        """Open the output. Raises CalibrationError for an invalid calibration file."""
        self._node, self._disc = node, float(values["disc"])
        self._calibration = load(Path(values["output_calibration"]))
        self._outputs = Outputs(Path(values["output"]))
        self._frequency = 0.0  # of the node's last state [Hz]: the voltage's amplitude is fitted at it
        self._states = node.create_publisher(ExcitationState, topic, STATES)
        subscribe(node, ExcitationState, "excitation/state", self._on_state, STATES)
        node.create_timer(_PERIOD, self._publish, clock=STEADY)

    def _on_state(self, state: ExcitationState) -> None:
        self._frequency = state.frequency or self._frequency

    def _publish(self) -> None:
        amplitude, frequency, volts = self._level() if self._disc else self._tone()
        running = ExcitationState.RUNNING if amplitude else ExcitationState.OFF
        header = Header(stamp=self._node.get_clock().now().to_msg(), frame_id=Frame.SUPPORT)
        state = ExcitationState(header=header, mode=running, amplitude=amplitude, frequency=frequency, output=volts)
        self._states.publish(state)

    def _level(self) -> tuple[float, float, float]:
        volts = self._outputs.volts(0)
        frequency = float(si_of(self._calibration, np.array([volts]))[0][0])
        return (self._disc, frequency, volts) if volts > 0.0 and frequency > 0.0 else (0.0, 0.0, volts)

    def _tone(self) -> tuple[float, float, float]:
        times, volts = self._outputs.recent(_WINDOW)
        low, high = self._calibration.limits_volts
        peak = float(np.abs(volts).max())
        if peak < _NOISE * (high - low) or not self._frequency:
            return 0.0, 0.0, peak
        angle = 2.0 * np.pi * self._frequency * times
        parts = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle)], axis=1), volts, rcond=None)[0]
        return float(np.hypot(*parts) * self._calibration.coefficients[1]), self._frequency, peak


_EMULATED = "emulated"
_IDLE_S = 0.01
_NOISE_TEXT = "standard deviation of the sensors' noise: a real laser has some, a frozen one none"
_CALIBRATIONS = ["emulated_support.yaml", "emulated_beam.yaml"]
PARAMETERS = (
    Entry("feed", "", "file of the feed, for example /dev/shm/atpid_laser; the device's source is feed: and this path"),
    Entry("topic", f"{_EMULATED}/sensors/laser", "the plant's sensor topic, remapped"),
    Entry("rate", 1000.0, "scans per second of that topic", "Hz", 0.1, 100_000.0),
    Entry("noise", 3e-4, _NOISE_TEXT, "V", 0.0, 1.0),
    Entry("rest", [0.0], "reading of each channel until the plant moves it; one entry stands for all", "m or N"),
    Entry("calibrations", _CALIBRATIONS, "calibration file of each channel, relative to calibration_folder"),
    Entry("calibration_folder", "", "folder of the calibration files; empty: those shipped with the package"),
    Entry("output", "", "file of the outputs of the device that excites; empty: none does"),
    Entry("output_calibration", "", "calibration file of that output, drive_amplitude or drive_frequency"),
    Entry("disc", 0.0, "amplitude of an eccentric drive's disc, whose frequency the output is", "", 0.0, 1e6),
)


class FeedNode(Node):
    """Converts metres to volts with the same calibration files the acquisition node converts back with."""

    def __init__(self, **kwargs: object) -> None:
        """Make the feed. Raises ParameterError or DriverError for an invalid parameter."""
        super().__init__("feed_node", **kwargs)
        try:
            values = declare(self, PARAMETERS)
            check_topic(self, values["topic"])
            if values["output"]:
                self._exciter = _EmulatedExciter(self, values, f"{_EMULATED}/excitation/state")
            self.feed = self._made(values)
        except InputError:
            super().destroy_node()
            raise
        self._random = np.random.default_rng(0)
        self._next: int | None = None
        self._live = False  # whether the device that reads the feed streams
        self._states = self.create_publisher(CeilingState, f"{_EMULATED}/ceiling/state", STATES)
        subscribe(self, CeilingState, "ceiling/state", self._on_state, STATES)
        subscribe(self, SampleBlock, "sensors/laser", self._on_device, BLOCKS)
        subscribe(self, SampleBlock, values["topic"], self._on_block, BLOCKS)
        subscribe(self, Event, "events", self._on_event, EVENTS)
        self._last = np.broadcast_to(self._rest, len(self._calibrations))
        self._began, self._idle = time.monotonic(), 0
        self._missing = 0  # scans of the plant that did not arrive
        self._timer = self.create_timer(_IDLE_S, self._feed_idle, clock=STEADY)
        self._announce_at = self._began + ANNOUNCE_AFTER
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)

    def _made(self, values: Document) -> Feed:
        """Return the feed that the parameters ask for. Raises DriverError."""
        if not values["feed"] or not values["calibrations"]:
            raise DriverError("feed_node needs the parameters feed (a file) and calibrations (one for each channel)")
        self._path = Path(values["feed"])
        _check_replaceable(self._path)
        self._calibrations = calibrations_of(values)
        self._rest = np.array(values["rest"])
        if len(self._rest) not in (1, len(self._calibrations)):
            allowed = f"one number, or one for each of {len(self._calibrations)} calibrations"
            raise DriverError(f"rest: given {values['rest']}; allowed: {allowed}")
        self._rate, self._noise = float(values["rate"]), float(values["noise"])
        return Feed(self._path, len(self._calibrations), self._rate)

    def _on_device(self, block: SampleBlock) -> None:
        self._live = self._live or not block.handshake

    def _on_state(self, state: CeilingState) -> None:
        if not state.handshake:
            self._states.publish(state)

    def _on_block(self, block: SampleBlock) -> None:
        if block.handshake:
            if self._live:
                self._states.publish(empty(CeilingState))
            elif time.monotonic() > self._announce_at:
                self._announce_at = time.monotonic() + ANNOUNCE_AGAIN
                self.get_logger().warning(f"no samples yet: waiting for {self._waiting_for()}")
            return
        names = [calibration.channel for calibration in self._calibrations]
        if list(block.channels) != names or block.rate != self._rate:
            given = f"{list(block.channels)} at {block.rate:g} Hz"
            self.get_logger().error(f"the plant gives {given}, expected {names} at {self._rate:g} Hz", once=True)
            return
        self._timer.cancel()
        if self._next is not None and block.first_index != self._next:
            self._missing += block.first_index - self._next
            self.get_logger().error(f"{block.first_index - self._next} scans of the plant are missing")
        values = np.frombuffer(block.data).reshape(-1, len(names))
        self._next = block.first_index + len(values)
        self._last = values[-1].copy()
        self._write(values)

    def _on_event(self, event: Event) -> None:
        """When the plant has finished, the body stays where it is, and the sensors go on."""
        if event.kind == Event.FINISHED:
            self._began, self._idle = time.monotonic(), 0
            self._timer.reset()

    def _feed_idle(self) -> None:
        due = int((time.monotonic() - self._began) * self._rate)
        self._write(np.tile(self._last, (due - self._idle, 1)))
        self._idle = due

    def _write(self, values: NDArray[np.float64]) -> None:
        columns = []
        for column, calibration in enumerate(self._calibrations):
            volts = volts_of(calibration, values[:, column])
            low, high = calibration.limits_volts
            columns.append(np.nan_to_num(volts, nan=high + 0.01 * (high - low)))  # saturated: beyond the limit
        frames = np.column_stack(columns)
        self.feed.write(frames + self._random.normal(0.0, self._noise, frames.shape))

    def _waiting_for(self) -> str:
        """Return what is missing before the plant may start, in words; empty: nothing."""
        return "" if self._live else f"sensors/laser of the device that reads {self._path}"

    def _statuses(self) -> list[DiagnosticStatus]:
        waiting = self._waiting_for()
        moving = self._next is not None and self._timer.is_canceled()
        message = f"waiting for {waiting}" if waiting else "fed by the plant" if moving else "last displacement, idle"
        values = {"file": self._path, "written [frames]": self.feed.written, "missing [scans]": self._missing}
        level = DiagnosticStatus.WARN if self._missing else DiagnosticStatus.OK
        return [diagnostic_status(self, "feed", level, message, values, "emulated device")]

    def destroy_node(self) -> None:
        """Remove the feed, then the node's own end."""
        self.feed.close()
        super().destroy_node()


def _check_replaceable(path: Path) -> None:
    """Raise DriverError where `path` is a file that was not made as a feed: it would be replaced, and then removed."""
    if path.is_file():
        with path.open("rb") as file:
            if file.read(len(FEED_MAGIC)) == FEED_MAGIC:
                return  # left behind by a node that was killed
    if path.exists() or path.is_symlink():
        raise DriverError(f"parameter feed: given {path}, which exists and is no feed; give the name of a new file")


main = partial(run_node, FeedNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
