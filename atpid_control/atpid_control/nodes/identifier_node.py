# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Answers each block of samples with one estimate of the excitation, and watches channels and stamps."""

import math
import sys
from dataclasses import replace
from functools import partial

from atpid_interfaces.msg import CeilingState, Event, Excitation, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.channel_monitor import ChannelState
from atpid_common.errors import BAD_INPUT
from atpid_common.latency import Latencies
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, STEADY, channels_of, nanoseconds_of, scans_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import LiveParameters
from atpid_common.nodes.single_instance import started_twice
from atpid_common.nodes.supervision import NodeMonitors
from atpid_common.parameters import Value, Values
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.vocabulary import Frame
from atpid_common.waiting import COMPILING, announced
from atpid_control.identification import Estimate, IdentificationError, Identifier, Quality, Settings, warm_up
from atpid_control.identification.estimate import ACCELERATION
from atpid_control.identification.excitation_kind import OtherExcitation
from atpid_control.identification.from_beam import ModelInverse
from atpid_control.loop.rumble import RumbleSettings, RumbleWatch
from atpid_control.loop.settings import identification_settings, settings_of
from atpid_control.loop.signal_watch import ClockWatch, SignalSettings, SignalWatch
from atpid_control.nodes.parameter_tables import IDENTIFIER
from atpid_sim.plant.stream import last_stamp_ns
from atpid_sim.scene import load_scene


class _SignalFaults:
    """One watch for each channel of the blocks it is given, and one for the stamps of each device."""

    def __init__(self, node: Node, events: EventPublisher, settings: SignalSettings, clock_tolerance: float) -> None:
        """Begin; `clock_tolerance` [s]: how far stamps may move away from the indices."""
        self._node, self._events = node, events
        self._settings, self._clock_tolerance = settings, clock_tolerance
        self._watches: dict[str, SignalWatch] = {}
        self._clocks: dict[str, ClockWatch] = {}

    def configure(self, settings: SignalSettings, clock_tolerance: float) -> None:
        """Judge by other thresholds from the next block on."""
        self._settings, self._clock_tolerance = settings, clock_tolerance
        for clock in self._clocks.values():
            clock.tolerance = clock_tolerance

    def take(self, block: SampleBlock, last_ns: int) -> None:
        """Judge a block whose last scan was taken at `last_ns`; publish what has changed."""
        for (name, readings), unit in zip(channels_of(block).items(), block.units, strict=False):
            watch = self._watches.setdefault(name, SignalWatch(self._settings))
            # an impact's acceleration has no limit
            watch.settings = self._settings if unit == "m" else replace(self._settings, largest_velocity=0.0)
            changed = watch.push(block.rate, readings)
            if changed is not None:
                again = " again" if changed.state is ChannelState.PLAUSIBLE else ""
                self._publish(not again, f"{name}: {changed.text}{again}", math.nan, last_ns)
        device = str(block.device)
        clock = self._clocks.setdefault(device, ClockWatch(self._clock_tolerance))
        faulty = clock.push(nanoseconds_of(block.header.stamp) * 1e-9, block.first_index, block.rate)
        if faulty is not None:
            off = f"are {clock.off:+.3f} s off their indices" if faulty else "agree with their indices again"
            self._publish(faulty, f"clock: the stamps of {device} {off}", clock.off, last_ns)

    def _publish(self, faulty: bool, text: str, value: float, stamp_ns: int) -> None:
        severity, kind = (Event.ALARM, Event.FAULT) if faulty else (Event.INFO, Event.RECOVERED)
        self._events.publish(severity, kind, text, value, time_of(stamp_ns))

    def statuses(self) -> list[DiagnosticStatus]:
        """Return one status for each channel and clock."""
        found = []
        for name, watch in self._watches.items():
            level = DiagnosticStatus.ERROR if watch.finding.state.severity else DiagnosticStatus.OK
            found.append(status(self._node, name, level, watch.finding.text, {"state": watch.finding.state.value}))
        for device, clock in self._clocks.items():
            level = DiagnosticStatus.ERROR if clock.faulty else DiagnosticStatus.OK
            text = f"stamps {clock.off:+.3f} s off their indices"
            found.append(status(self._node, f"clock of {device}", level, text, {"off [s]": clock.off}))
        return found


LASER, _ACCELEROMETER = "sensors/laser", "sensors/accelerometer"


#: What may change while the node runs.
_Live = tuple[Settings, RumbleSettings, float, tuple[SignalSettings, float]]


class IdentifierNode(Node):
    """Parameters, topics, and one call into the identification for each block."""

    def __init__(self, **node_options: object) -> None:
        """Raise ParameterError, IdentificationError, WatchError or SceneError, in one line, for bad parameters.

        `done`: exit status.
        """
        super().__init__("identifier_node", **node_options)
        self.parameters = LiveParameters(self, IDENTIFIER)
        self._names = (self.parameters["support_channel"], self.parameters["beam_channel"])
        inverse = _inverse_of(self.parameters.__getitem__)
        settings, rumble, timeout, signals = _settings(self.parameters.__getitem__)
        self.identifier = Identifier(settings, inverse)
        with announced(COMPILING, self.get_logger().info):
            warm_up()
        self._rumble = RumbleWatch(rumble)
        self._other: OtherExcitation | None = None
        self._units = "m", "m"  # of excitation and beam: those of their channels
        self.done: Future = Future()
        self._height = math.nan
        self._progress = _Progress()
        self.last_error = ""  # last error of a block, one sentence
        self._make_topics(timeout, from_beam=inverse is not None)
        self._signals = _SignalFaults(self, self._events, *signals)
        self.parameters.follow(_settings, self._configure, self._events.publish)

    def _make_topics(self, timeout: float, *, from_beam: bool) -> None:
        self._events = EventPublisher(self)
        real_time = not self.parameters["lockstep"]
        self._supervision = NodeMonitors(self, self._events.publish, self._statuses, timeout, enabled=real_time)
        self._supervision.stale.watch(LASER, "the excitation is not identified")
        self._supervision.follow_events()
        qos = self._supervision.qos
        self._excitation = self.create_publisher(
            Excitation, "excitation", EVENTS, event_callbacks=qos.publisher("excitation")
        )
        subscribe(self, SampleBlock, LASER, self._on_block, BLOCKS, event_callbacks=qos.subscription(LASER))
        # no controller reads it: it is only watched here
        subscribe(self, SampleBlock, _ACCELEROMETER, self._on_accelerometer, BLOCKS)
        if from_beam:
            subscribe(self, CeilingState, "ceiling/state", self._on_state, STATES)
        self._alone_timer = self.create_timer(1.0, self._check_alone, clock=STEADY)

    def _statuses(self) -> list[DiagnosticStatus]:
        return [self._progress.status(self, self.last_error, self._other, self._unit), *self._signals.statuses()]

    def _configure(self, settings: _Live) -> None:
        self.identifier.configure(settings[0])
        self._rumble.settings = settings[1]
        self._supervision.stale.timeout = settings[2]
        self._signals.configure(*settings[3])

    def _on_state(self, state: CeilingState) -> None:
        self._height = state.height

    def _on_accelerometer(self, block: SampleBlock) -> None:
        if not block.handshake:
            self._signals.take(block, last_stamp(block))

    def _on_block(self, block: SampleBlock) -> None:
        if block.handshake:
            self._excitation.publish(Excitation(header=block.header, handshake=True, **_fields(Estimate())))
            return
        scans = scans_of(block)
        last_ns = last_stamp(block)
        self._supervision.stale.received(LASER, last_ns, scans / block.rate if block.rate > 0.0 else 0.0)
        received_ns = self.get_clock().now().nanoseconds
        self._signals.take(block, last_ns)
        try:
            estimate, self.last_error = self._identify(block, last_ns), ""
        except IdentificationError as error:
            if str(error) != self.last_error:
                self.get_logger().error(str(error))
            self.last_error = str(error)
            estimate = Estimate()
        message = Excitation(**_fields(estimate))
        message.header.stamp, message.header.frame_id = time_of(last_ns), Frame.SUPPORT
        message.device = block.device
        # before the estimate, so that the node that answers it has received the rumble first
        self._watch(block, estimate, message)
        self._publish_change(estimate, message)
        self._publish_other(message)
        self._excitation.publish(message)
        self._progress.add(block, estimate)
        self._progress.received.add(received_ns - last_ns)
        self._progress.answered.add(self.get_clock().now().nanoseconds - last_ns)

    def _identify(self, block: SampleBlock, last_ns: int) -> Estimate:
        channels, samples = list(block.channels), channels_of(block)
        support, beam = (samples.get(name) for name in self._names)
        source = self._names[self.identifier.source]
        if source not in channels:
            raise IdentificationError(
                f"{source}: given channels {', '.join(channels) or 'none'}; set support_channel or beam_channel to one"
            )
        if len(block.units) == len(channels):
            units = dict(zip(channels, block.units, strict=True))
            self._units = units.get(self._names[0], "m"), units.get(self._names[1], "m")
        delay = block.skew[channels.index(source)] if len(block.skew) == len(channels) else 0.0
        time = last_ns * 1e-9
        return self.identifier.push(
            block.first_index, block.rate, support, beam, time, delay=delay, height=self._height, units=self._units
        )

    @property
    def _unit(self) -> str:
        """Unit of the excitation's amplitude: of an acceleration that of its displacement."""
        return "m" if self._units[0] == ACCELERATION else self._units[0]

    def _watch(self, block: SampleBlock, estimate: Estimate, message: Excitation) -> None:
        """Publish an event when the beam begins to rumble, and when it is regular again."""
        beam = channels_of(block).get(self._names[1])
        if beam is None or self._units[1] == ACCELERATION:  # impacts are most of it
            return
        before = self._rumble.state
        after = self._rumble.push(block.first_index, block.rate, beam, estimate.frequency)
        if after.rumbling != before.rumbling:
            severity, kind, text = Event.INFO, Event.CALM, "the beam's response is regular again"
            if after.rumbling:
                severity, kind = Event.WARNING, Event.RUMBLE
                scatter = f"scatters by {after.scatter:.1%} from period to period"
                text = f"the beam's amplitude {scatter} at {after.amplitude:.4f} m"
            self._events.publish(severity, kind, text, after.scatter, message.header.stamp)

    def _publish_change(self, estimate: Estimate, message: Excitation) -> None:
        """Publish a change once, when it has become steady again: then its size is known."""
        if estimate.changed and estimate.quality == Quality.STEADY:
            text = f"excitation is now {estimate.amplitude:.5f} {self._unit} at {estimate.frequency:.3f} Hz"
            stamp = message.header.stamp
            self._events.publish(Event.INFO, Event.EXCITATION_CHANGED, text, estimate.amplitude, stamp)

    def _publish_other(self, message: Excitation) -> None:
        """Publish when what excites the structure is no tone, and when it is one again."""
        found, before = self.identifier.other, self._other
        self._other = found
        if (found and found.kind) == (before and before.kind):
            return
        tones = any(one is not None and one.kind == "tones" for one in (found, before))
        kind = Event.TWO_TONES if tones else Event.EXCITATION_CHANGED
        if found is not None:
            severity = Event.WARNING if found.spoils else Event.INFO
            text, value = found.sentence(self._units[0]), found.amplitudes[-1]
        elif before is not None and before.spoils:
            severity, text, value = Event.INFO, "one tone excites the structure again, or nothing", math.nan
        else:
            return
        self._events.publish(severity, kind, text, value, message.header.stamp)

    def _check_alone(self) -> None:
        if started_twice(self) and self._progress.blocks == 0 and not self.done.done():
            self.done.set_result(BAD_INPUT)

    def close(self) -> None:
        """Stop the timers."""
        self._supervision.close()
        self._alone_timer.cancel()


class _Progress:
    """Data of the diagnostics: blocks answered, latencies, scans lost."""

    def __init__(self) -> None:
        self.blocks = 0
        self.received, self.answered = Latencies(), Latencies()
        self._missing = 0
        self._expected: int | None = None
        self._rate = math.nan
        self._device = ""
        self._latest = Estimate()

    def add(self, block: SampleBlock, estimate: Estimate) -> None:
        if self._expected is not None and block.first_index > self._expected:
            self._missing += block.first_index - self._expected
        self._expected = block.first_index + scans_of(block)
        self.blocks += 1
        self._rate, self._latest, self._device = block.rate, estimate, block.device

    def status(self, node: Node, last_error: str, other: OtherExcitation | None, unit: str) -> DiagnosticStatus:
        latest, poor = self._latest, self._latest.quality == Quality.POOR
        values: dict[str, object] = {"blocks": self.blocks, "rate [Hz]": self._rate, "missing scans": self._missing}
        values |= {"quality": latest.quality.name, f"amplitude [{unit}]": latest.amplitude}
        values |= {"frequency [Hz]": latest.frequency, "last error": last_error or "none"}
        latency = self.received.values("sample to block") | self.answered.values("sample to estimate")
        text = "poor estimate" if poor else "identifying" if self.blocks else "waiting for samples"
        text = other.sentence(unit) if other else text
        values["excitation"] = other.kind if other else "tone" if math.isfinite(latest.frequency) else "none"
        level = DiagnosticStatus.ERROR if last_error else DiagnosticStatus.WARN if poor else DiagnosticStatus.OK
        return status(node, "identification", level, last_error or text, values | latency, self._device or "none")


def _inverse_of(value: Value) -> ModelInverse | None:
    """Return the model from beam to support, None where the support is measured.

    Raises IdentificationError, SceneError.
    """
    if value("origin") == "support":
        return None
    if not value("scene"):
        raise IdentificationError("scene: given none; allowed with origin beam: the scene file of the beam and damper")
    return ModelInverse.of_scene(load_scene(value("scene")))


def _settings(value: Value) -> _Live:
    """Return what may change while the node runs; raise InputError where it contradicts itself."""
    signals = settings_of(SignalSettings, value), float(value("clock_tolerance"))
    return (
        identification_settings(value),
        settings_of(RumbleSettings, value, "rumble_"),
        float(value("stale_timeout")),
        signals,
    )


def last_stamp(block: SampleBlock) -> int:
    """Return when the block's last scan was taken [ns]."""
    return last_stamp_ns(nanoseconds_of(block.header.stamp), block.first_index, scans_of(block), block.rate)


#: Fields of an estimate that the message does not have.
_NOT_IN_MESSAGE = ("time", "growth", "growth_std", "drift")


def _fields(estimate: Estimate) -> Values:
    fields = {name: value for name, value in vars(estimate).items() if name not in _NOT_IN_MESSAGE}
    return fields | {"quality": int(estimate.quality), "origin": int(estimate.origin)}


main = partial(run_node, IdentifierNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
