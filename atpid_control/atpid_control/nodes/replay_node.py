# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into identifier and selector in place of plant or stand, with /clock."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import CeilingCommand, Event, Excitation, RecorderStatus
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.handshake import Handshake, empty_block
from atpid_common.nodes.messages import BLOCKS, STATES, STATUS, nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.single_instance import StartedTwiceError, check_alone
from atpid_control.recording.definitions import split_name
from atpid_control.recording.errors import BagError
from atpid_control.recording.playback import Item, load_playback
from atpid_control.recording.topics import BLOCK

DONE, BAD_INPUT = 0, 2
LEAVE_PERIOD = 0.05  # between two looks whether the bag is closed [s]
TURN = 0.005  # how finely a paced replay is cut, and /clock with it [s]
PATIENCE = 5.0  # how long an answer may take before somebody is told [s]
#: Stamps of one instant may differ by rounding [ns].
SAME_INSTANT = 10_000

ANSWERS = {"ceiling/command": CeilingCommand, "excitation": Excitation}
PARAMETERS: tuple[tuple[str, Any, str], ...] = (
    ("bag", "", "folder of the bag to play"),
    (
        "topics",
        ["sensors/*"],
        "topics to play, * for anything; add ceiling/state where the selector needs to know the height",
    ),
    (
        "answer",
        "ceiling/command",
        "whose answer ends a block: ceiling/command, or excitation where there is no selector",
    ),
    ("expect_recorder", False, "true: do not start before the recorder receives, nor leave before its bag is closed"),
)


class ReplayNode(Node):
    """Parameters, topics, the handshake, and one message after the other."""

    def __init__(self, *, parameter_overrides: list[Parameter] | None = None, **node_options: Any) -> None:
        """Read the bag; raise BagError where it cannot be played. `done` receives the exit status."""
        super().__init__("replay_node", parameter_overrides=parameter_overrides, **node_options)
        for name, default, text in PARAMETERS:
            self.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=True))
        self._declare_rate()
        self._rate = float(self._value("rate"))
        self._expect_recorder = bool(self._value("expect_recorder"))
        if self._value("answer") not in ANSWERS:
            raise BagError(f"parameter answer: given {self._value('answer')!r}; allowed: {', '.join(ANSWERS)}")
        if not self._value("bag"):
            raise BagError("parameter bag: not given; allowed: the folder of a bag (--ros-args -p bag:=FOLDER)")
        self.playback = load_playback(Path(self._value("bag")), list(self._value("topics")))
        self.done: Future = Future()
        self.played = 0
        self._recorder: RecorderStatus | None = None
        self._awaited: int | None = None  # stamp of the answer that lets the next block out [ns]
        self._asked = self._started = 0.0  # steady [s]
        self._ended: int | None = None
        self._make_topics()

    def _declare_rate(self) -> None:
        allowed = FloatingPointRange(from_value=0.0, to_value=1000.0)
        text = "speed against the recording; 0: as fast as the loop answers, block by block"
        described = ParameterDescriptor(description=text, read_only=True, floating_point_range=[allowed])
        self.declare_parameter("rate", 1.0, described)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _make_topics(self) -> None:
        self._out = {
            topic: self.create_publisher(_class_of(kind), topic, BLOCKS) for topic, kind in self.playback.topics.items()
        }
        self._clock = self.create_publisher(ClockMessage, "/clock", 10)
        self._events = EventPublisher(self)
        answer = self._value("answer")
        self.create_subscription(ANSWERS[answer], answer, self._on_answer, STATES)
        self.create_subscription(RecorderStatus, "recorder/status", self._on_recorder, STATUS)
        # paced by the wall whatever /clock says: this node is the one that says it
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._handshake = Handshake(
            self,
            self._publish_handshake,
            self._start,
            topics=[*self.playback.channels, answer],
            answer=answer,
            recorder=self._expect_recorder,
        )
        self._turn_timer = self.create_timer(TURN, self._turn, clock=steady)
        self._turn_timer.cancel()

    # the handshake

    def _publish_handshake(self) -> None:
        if self._not_alone():
            self._handshake.cancel()
            self._finish(BAD_INPUT)
            return
        self._publish_clock(self.playback.start_ns)
        for topic, (channels, units) in self.playback.channels.items():
            self._out[topic].publish(empty_block(channels, units))

    def _start(self) -> None:
        self._started = self._asked = time.monotonic()
        self._turn_timer.reset()
        if not self._rate:
            self._next_block()

    def _not_alone(self) -> bool:
        """Whether somebody else feeds the loop too; says so."""
        try:
            check_alone(self)
        except StartedTwiceError as error:
            self.get_logger().error(str(error))
            return True
        for topic, kind in self.playback.topics.items():
            if kind == BLOCK and self.count_publishers(topic) > 1:
                self.get_logger().error(f"{topic} is being published by another node: stop it before a replay")
                return True
        return False

    # the loop

    def _on_recorder(self, status: RecorderStatus) -> None:
        self._recorder = status
        self._handshake.on_status(status)

    def _on_answer(self, message: Any) -> None:
        if message.handshake:
            self._handshake.on_answer(message)
            return
        if self._awaited is not None and nanoseconds_of(message.header.stamp) >= self._awaited - SAME_INSTANT:
            self._awaited = None
            if not self._rate:
                self._next_block()
            elif self.played == len(self.playback.items):
                self._end()

    def _next_block(self) -> None:
        """Play up to and with the next block that is answered."""
        while self.played < len(self.playback.items):
            item = self.playback.items[self.played]
            if item.answer_ns is not None:
                self._publish_clock(item.time_ns)
            self._play(item)
            if item.answer_ns is not None:
                return
        self._end()

    def _turn(self) -> None:
        """Play what is due, where the replay is paced; see that answers come."""
        now = time.monotonic()
        if self._rate:
            bag_ns = self.playback.start_ns + round((now - self._started) * self._rate * 1e9)
            self._publish_clock(bag_ns)
            while self.played < len(self.playback.items) and self.playback.items[self.played].time_ns <= bag_ns:
                self._play(self.playback.items[self.played])
            if self.played == len(self.playback.items) and self._awaited is None:
                self._end()
        if self._awaited is not None and now - self._asked > PATIENCE:
            self._asked = now
            at = (self._awaited - self.playback.start_ns) * 1e-9
            answer = self._value("answer")
            self.get_logger().warning(f"no {answer} answers the block that ends at {at:.3f} s: do its nodes still run?")

    def _play(self, item: Item) -> None:
        self.played += 1
        if item.answer_ns is not None:
            # before publishing: in one process the answer may come back at once
            self._awaited, self._asked = item.answer_ns, time.monotonic()
        self._out[item.topic].publish(item.data)

    def _publish_clock(self, nanoseconds: int) -> None:
        self._clock.publish(ClockMessage(clock=time_of(nanoseconds)))

    # the end

    def _end(self) -> None:
        """Say that the bag is over, let the recorder close its own, and leave."""
        if self._ended is not None:
            return
        wall = max(time.monotonic() - self._started, 1e-9)
        seconds = self.playback.seconds
        text = f"{seconds:g} s replayed in {wall:.2f} s ({seconds / wall:.1f} x real time)"
        self._events.publish(Event.INFO, Event.FINISHED, text, seconds, time_of(self.playback.last_stamp_ns))
        self._ended = DONE
        self._turn_timer.cancel()
        self._leave_timer = self.create_timer(
            LEAVE_PERIOD, self._leave_when_heard, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _leave_when_heard(self) -> None:
        if self._expect_recorder and self._recorder is not None and self._recorder.recording:
            return
        self._leave_timer.cancel()
        self._finish(DONE)

    def _finish(self, status: int) -> None:
        self._ended = status
        for publisher in (*self._out.values(), self._events.publisher):
            publisher.wait_for_all_acked(Duration(seconds=1.0))
        if not self.done.done():
            self.done.set_result(status)

    def close(self) -> None:
        """Stop the timers; whoever listens notices the silence."""
        self._handshake.cancel()
        self._turn_timer.cancel()


def _class_of(name: str) -> type[Any]:
    package, message = split_name(name)
    found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), message)
    return found


def main(args: Sequence[str] | None = None) -> int:
    """Replay as a process of its own; return the exit status."""
    return run_node(ReplayNode, args)


if __name__ == "__main__":
    sys.exit(main())
