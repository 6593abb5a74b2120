# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulated stand: publishes what the sensors of a scene's plant read; its ceiling follows the motor's reports.

Where the scene's excitation is commanded the support, or the force, follows the reports of the excitation node.
"""

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import CeilingState, Event, ExcitationState, PlantTruth, SampleBlock
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from atpid_common.errors import BAD_INPUT, DONE, NUMERICAL_FAILURE
from atpid_common.injected_faults import CEILING, SENSORS, FaultError, Injected, overlapping, parsed
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.handshake import LOOP_TOPICS, Handshake, empty_block
from atpid_common.nodes.messages import BLOCKS, STATES, STEADY, nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import Entry, LiveParameters, Value
from atpid_common.nodes.recorder_watch import Leaving, RecorderWatch
from atpid_common.nodes.single_instance import is_alone, started_twice
from atpid_common.real_time import LOOP_PRIORITY
from atpid_common.waiting import COMPILING, announced
from atpid_sim.nodes.messages import handshake_truth, sample_block, scene_given, truth_message
from atpid_sim.outcome import NumericalFailure, Outcome
from atpid_sim.plant.plant import Plant
from atpid_sim.plant.stream import DeviceBlock, PlantLike, Stream, stamp_ns, stamp_shift
from atpid_sim.scene import Scene

#: Between two blocks that are late: the ceiling's answers are received in between [s].
_CATCH_UP = 1e-3
#: An exciter whose node is silent for longer is off; its states come 20 times a second [s].
_DRIVE_SILENCE = 0.2

_FAULTS = "injected faults beside the scene's: 'PART KIND FROM TO [VALUE]' (docs/faults.md); empty: none"
PARAMETERS = (
    Entry("scene", "", "scene file (docs/scenes.md)"),
    Entry("lockstep", False, "true: each block waits for the ceiling's answer to the last; false: real time"),
    Entry("expect_recorder", False, "true: start when the recorder receives every topic, leave when its bag is closed"),
    Entry("faults", [""], _FAULTS, live=True),
)
#: The parts whose faults the plant injects.
_INJECTED = (*SENSORS, "clock")


class PlantNode(Node):
    """Parameters, topics, the handshake, and one call into the stream for each block."""

    def __init__(self, *, make_plant: Callable[[Scene], PlantLike] = Plant, **node_options: Any) -> None:
        """Read the scene; raise SceneError or StreamError where it cannot be run. `done` receives the exit status."""
        super().__init__("plant_node", **node_options)
        values = LiveParameters(self, PARAMETERS)
        scene = scene_given(self)
        self._scene_name = Path(values["scene"]).name
        self._lockstep, expect_recorder = bool(values["lockstep"]), bool(values["expect_recorder"])
        with announced(COMPILING, self.get_logger().info):
            # a block that is not used: loading the kernels must not fall into the first block's time
            Stream(scene, make_plant(scene)).advance(scene.ceiling.heights[0][1], 0.0)
        self._plant: Any = make_plant(scene)
        self._commanded = scene.excitation.is_commanded
        self.stream = Stream(scene, self._plant)
        self._drive: ExcitationState | None = None
        self._drive_received = 0.0  # steady [s]
        self._scene_faults, self._seed = scene.injected, scene.seed
        self.stream.faults = self._faults(values.__getitem__)
        self.failure = ""  # what went wrong with the plant, one sentence
        self._ceiling: CeilingState | None = None
        self._awaited: int | None = None  # stamp whose answer lets the next block start [ns], lockstep only
        self._start_ns = 0
        self._steady_start = 0.0
        self._worst_lag = self._behind = 0.0
        self._make_topics()
        self._leaving = Leaving(
            self,
            lambda: [*self._sensors.values(), self._truth, self._events.publisher],
            lambda: expect_recorder and self._recorder.recording,
        )
        self.done = self._leaving.done
        self._handshake = Handshake(
            self,
            self._publish_handshake,
            self._start,
            topics=[*(f"sensors/{device}" for device in self._sensors), "plant/truth", *LOOP_TOPICS],
            recorder=expect_recorder,
            blocked=self._blocked,
        )
        on_status = self._handshake.on_status
        self._recorder = RecorderWatch(self, on_status, self._report_recorder, expected=expect_recorder)
        self._pace_timer = self.create_timer(self.stream.block_seconds, self._pace, clock=STEADY)
        self._pace_timer.cancel()
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)
        values.follow(self._faults, partial(setattr, self.stream, "faults"), self._events.publish)

    def _make_topics(self) -> None:
        self._sensors = {
            item.device: self.create_publisher(SampleBlock, f"sensors/{item.device}", BLOCKS)
            for item in self.stream.instruments
        }
        self._truth = self.create_publisher(PlantTruth, "plant/truth", BLOCKS)
        self._events = EventPublisher(self)
        # a motor or height sensor that fails reports another height than the ceiling has, which then comes by itself
        self._differs = any(fault.part in CEILING for fault in self._scene_faults)
        if not (self._differs and self._lockstep):
            subscribe(self, CeilingState, "ceiling/state", self._on_report, STATES)
        if self._differs or not self._lockstep:  # in real time they may be injected later
            subscribe(self, CeilingState, "ceiling/truth", self._on_truth, STATES)
        if self._commanded:
            subscribe(self, ExcitationState, "excitation/state", self._on_drive, STATES)

    # faults

    def _faults(self, value: Value) -> tuple[Injected, ...]:
        """Return the faults of scene and parameter. Raises FaultError for one that is invalid here."""
        faults = (*self._scene_faults, *parsed(value("faults"), _INJECTED, "the plant"))
        devices = [item.device for item in self.stream.instruments]
        if "accelerometer" not in devices and any(fault.part == "accelerometer" for fault in faults):
            raise FaultError("faults: given accelerometer; the scene has none; add sensors.accelerometer to it")
        if "support_displacement" not in self.stream.laser.channels and any(f.part == "support_laser" for f in faults):
            raise FaultError("faults: given support_laser; a force drives the scene, whose load cell has no faults")
        if both := overlapping(faults):
            raise FaultError(f"faults: given {both[0]} and {both[1]}; allowed: one fault of a part at a time")
        return faults

    # the handshake

    def _publish_handshake(self) -> None:
        if started_twice(self):
            self._handshake.cancel()
            self._leaving.at_once(BAD_INPUT)
            return
        for item in self.stream.instruments:
            self._sensors[item.device].publish(empty_block(item.channels, item.units))
        self._truth.publish(handshake_truth(self.stream.height))
        self._events.publish_handshake()

    def _start(self) -> None:
        self._steady_start = time.monotonic()
        self._start_ns = 0 if self._lockstep else time.time_ns()
        seconds = self.stream.ticks / self.stream.rate
        text = f"{self._scene_name}: {seconds:g} s in {'lockstep' if self._lockstep else 'real time'}"
        self._publish_event(Event.INFO, Event.STARTED, text, seconds)
        if self._lockstep:
            self._next_block()
        else:
            self._wait_for_block()

    def _blocked(self) -> str:
        if not is_alone(self):
            return "another node of this name to leave"
        return "excitation_node (excitation/state)" if self._commanded and self._drive is None else ""

    def waiting_for(self) -> str:
        """What the handshake still lacks, in words; empty: nothing."""
        return self._handshake.waiting_for()

    # the loop

    def _report_recorder(self, severity: int, kind: str, text: str, value: float) -> None:
        if self._lockstep:  # whose events depend on the run alone, not on the machine
            self.get_logger().warning(text)
        else:
            self._publish_event(severity, kind, text, value)

    def _on_report(self, state: CeilingState) -> None:
        if not self._differs:
            self._on_ceiling(state)

    def _on_truth(self, state: CeilingState) -> None:
        self._differs = True
        self._on_ceiling(state)

    def _on_ceiling(self, state: CeilingState) -> None:
        if state.handshake:
            self._handshake.on_answer(state)
            return
        self._ceiling = state
        self._go_on()

    def _on_drive(self, state: ExcitationState) -> None:
        self._drive, self._drive_received = state, time.monotonic()
        self._go_on()

    def _go_on(self) -> None:
        """Compute the next block once all have answered the last one, in lockstep."""
        answers = [self._ceiling, self._drive] if self._commanded else [self._ceiling]
        stamps = {None if one is None else nanoseconds_of(one.header.stamp) for one in answers}
        if self._awaited is None or stamps != {self._awaited}:
            return
        self._awaited = None
        self._next_block()

    def _excite(self) -> None:
        """Pass the exciter's state on to the plant: none, or an old one, is no excitation."""
        old = not self._lockstep and time.monotonic() - self._drive_received > _DRIVE_SILENCE
        state = ExcitationState() if self._drive is None or old else self._drive
        self._plant.excite(state.amplitude, state.frequency)

    def _pace(self) -> None:
        """Publish the block that is due; one a call, so that the ceiling's answers are received in between."""
        lag = self._lag()
        if self._leaving.status is not None:
            return
        if lag < 0.0:  # by rounding
            self._wait_for_block()
            return
        self._worst_lag = max(self._worst_lag, lag)
        if lag > self.stream.block_seconds >= self._behind:
            text = f"the plant is {lag:.3f} s behind real time: the machine is too slow or too busy"
            self._publish_event(Event.WARNING, Event.BEHIND, text, lag)
        self._behind = lag
        self._next_block()
        if self._leaving.status is None:
            self._wait_for_block()

    def _wait_for_block(self) -> None:
        """Set the timer to when the next block is due: waking up more often costs the loop time."""
        self._pace_timer.timer_period_ns = round(max(_CATCH_UP, -self._lag()) * 1e9)
        self._pace_timer.reset()

    def _lag(self) -> float:
        """How long ago the next block's last sample was due [s]; negative: not due yet."""
        due = min(self.stream.computed_ticks + self.stream.ticks_per_block, self.stream.ticks) / self.stream.rate
        return time.monotonic() - self._steady_start - due

    def _next_block(self) -> None:
        if self.stream.finished:
            self._end(Event.INFO, DONE, self._summary())
            return
        try:
            if self._commanded:
                self._excite()
            block = self.stream.advance(*self._ceiling_target())
            outcome = Outcome(block.truth.outcome)
        except NumericalFailure as failure:
            self._end(Event.ALARM, NUMERICAL_FAILURE, str(failure))
            return
        if outcome is not Outcome.DONE:
            self._end(Event.ALARM, NUMERICAL_FAILURE, outcome.sentence)
            return
        if self._lockstep:
            # before publishing: in one process the answer may come back at once; it has the stamp, of a faulty clock
            # too, of the last laser sample
            laser = block.readings[0]
            last_ns = stamp_ns(self._start_ns, laser.first_index + len(laser.data) - 1, laser.rate)
            self._awaited = last_ns + self._shift(laser)
        for reading in block.readings:
            device, shift = reading.instrument.device, self._shift(reading)
            self._sensors[device].publish(sample_block(reading, self._start_ns, device, shift))
        self._truth.publish(truth_message(block, self._start_ns))
        if self.stream.finished and not self._lockstep:
            self._end(Event.INFO, DONE, self._summary())

    def _ceiling_target(self) -> tuple[float, float]:
        """Target [m] and speed [m/s] of the ceiling during the next block; speed 0 holds."""
        state = self._ceiling
        if state is None:
            return self.stream.height, 0.0
        target = state.target if state.mode == CeilingState.MOVING else state.height
        known = math.isfinite(target) and math.isfinite(state.speed)
        return (target, abs(state.speed)) if known else (self.stream.height, 0.0)

    def _shift(self, reading: DeviceBlock) -> int:
        """By how much a faulty clock's stamp of a reading is off [ns]."""
        first_ns = stamp_ns(self._start_ns, reading.first_index, reading.rate)
        shift = stamp_shift(self.stream.faults, reading.first_index / reading.rate, first_ns, self._seed)
        return max(-first_ns, shift)

    # the end

    def _summary(self) -> str:
        simulated = self.stream.computed_ticks / self.stream.rate
        if self._lockstep:
            # nothing of the machine's speed: two runs with the same seed give the same messages
            return f"{simulated:g} s simulated in {self.stream.blocks} blocks"
        return f"{simulated:g} s in real time; at worst {1e3 * self._worst_lag:.0f} ms behind the clock"

    def _end(self, severity: int, status: int, text: str) -> None:
        """Publish how the run ended, let the recorder close its bag, and leave with `status`."""
        simulated = self.stream.computed_ticks / self.stream.rate
        if status == NUMERICAL_FAILURE:
            text = self.failure = f"the plant stopped at {simulated:g} s: {text}"
            self._publish_event(severity, Event.FAILED, text)
        self._pace_timer.cancel()
        self._publish_event(severity, Event.FINISHED, text, simulated)
        self._leaving.when_recorded(status)

    def _publish_event(self, severity: int, kind: str, text: str, value: float = math.nan) -> None:
        last = max(0, self.stream.computed_scans - 1)  # of the laser's samples so far
        stamp = stamp_ns(self._start_ns, last, self.stream.laser.rate)
        self._events.publish(severity, kind, text, value, time_of(stamp))

    def _statuses(self) -> list[DiagnosticStatus]:
        """Return the state of the run, for /diagnostics."""
        ended = self._leaving.status is not None
        waiting = self.waiting_for() if self._handshake.active else ""
        state = f"waiting for {waiting}" if waiting else "ended" if ended else "streaming"
        behind = self._behind > self.stream.block_seconds
        level = DiagnosticStatus.ERROR if self.failure else DiagnosticStatus.WARN if behind else DiagnosticStatus.OK
        values = {
            "scene": self._scene_name,
            "simulated [s]": self.stream.computed_ticks / self.stream.rate,
            "behind real time, at worst [s]": self._worst_lag,
            "ceiling height [m]": self.stream.height,
            "recorder": "gone" if self._recorder.gone else "recording" if self._recorder.recording else "none",
        }
        message = self.failure or ("behind real time" if behind else state)
        return [diagnostic_status(self, "simulated plant", level, message, values, "simulated plant")]

    def close(self) -> None:
        """Stop the timers; a plant has nothing else to release."""
        self._handshake.cancel()
        self._pace_timer.cancel()
        self._recorder.cancel()
        self._diagnostics.cancel()


main = partial(run_node, PlantNode, priority=LOOP_PRIORITY)

if __name__ == "__main__":
    sys.exit(main())
