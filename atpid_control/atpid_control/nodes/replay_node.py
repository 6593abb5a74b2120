# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into identifier and selector in place of plant or stand, with /clock."""

import sys
import time
from functools import partial
from pathlib import Path

from atpid_interfaces.msg import CeilingCommand, Event, Excitation
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage

from atpid_common.errors import BAD_INPUT, DONE
from atpid_common.nodes.checked import subscribe
from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.handshake import Handshake, empty_block
from atpid_common.nodes.messages import BLOCKS, STATES, STEADY, nanoseconds_of, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.nodes.recorder_watch import Leaving, RecorderWatch
from atpid_common.nodes.single_instance import started_twice
from atpid_common.parameters import Entry
from atpid_control.nodes.bag_qos import class_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.playback import Item, load_playback
from atpid_control.runs.topics import BLOCK

_TURN = 0.005  # resolution of a paced replay, and of /clock [s]
_TIMEOUT = 5.0  # how long an answer may take before a warning [s]
#: Stamps of one instant may differ by rounding [ns].
_SAME_INSTANT = 10_000
_ANSWERS = {"ceiling/command": CeilingCommand, "excitation": Excitation}
PARAMETERS = (
    Entry("bag", "", "folder of the bag to play"),
    Entry("rate", 1.0, "speed against the recording; 0: as fast as the loop answers, block by block", "", 0.0, 1000.0),
    Entry("topics", ["sensors/*"], "topics to play, * for anything; ceiling/state where the selector needs the height"),
    Entry("answer", "ceiling/command", "whose answer ends a block; excitation: no selector", choices=tuple(_ANSWERS)),
    Entry("expect_recorder", False, "true: start when the recorder receives every topic, leave when its bag is closed"),
)


class ReplayNode(Node):
    """Parameters, topics, the handshake, and one message after the other."""

    def __init__(self, **node_options: object) -> None:
        """Read the bag; raise BagError where it cannot be played. `done` receives the exit status."""
        super().__init__("replay_node", **node_options)
        values = declare(self, PARAMETERS)
        self._rate, self._answer = float(values["rate"]), str(values["answer"])
        if not values["bag"]:
            raise BagError("parameter bag: not given; allowed: the folder of a bag (--ros-args -p bag:=FOLDER)")
        self._bag = Path(values["bag"])
        self.playback = load_playback(self._bag, list(values["topics"]))
        for note in self.playback.notes:
            self.get_logger().info(note)
        self.played = 0
        self._awaited: int | None = None  # stamp of the answer after which the next block is played [ns]
        self._played_at = self._started = 0.0  # steady clock [s]
        self._make_topics(bool(values["expect_recorder"]))

    def _make_topics(self, expect_recorder: bool) -> None:
        self._out = {
            topic: self.create_publisher(class_of(kind), topic, BLOCKS) for topic, kind in self.playback.topics.items()
        }
        self._clock_out = self.create_publisher(ClockMessage, "/clock", 10)
        self._events = EventPublisher(self)
        subscribe(self, _ANSWERS[self._answer], self._answer, self._on_answer, STATES)
        # a warning, no event: a replay is recorded by its stamps, and two of one bag give the same
        self._recorder = RecorderWatch(
            self,
            lambda status: self._handshake.on_status(status),
            lambda _severity, _kind, text, _value: self.get_logger().warning(text),
            expected=expect_recorder,
        )
        self._leaving = Leaving(
            self,
            lambda: (*self._out.values(), self._events.publisher),
            lambda: expect_recorder and self._recorder.recording,
        )
        self.done = self._leaving.done
        self._handshake = Handshake(
            self,
            self._publish_handshake,
            self._start,
            topics=[*self.playback.channels, "events", "excitation", self._answer],
            answer=self._answer,
            recorder=expect_recorder,
        )
        # paced by the steady clock whatever /clock is: this node publishes it
        self._turn_timer = self.create_timer(_TURN, self._turn, clock=STEADY)
        self._turn_timer.cancel()
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)

    # the handshake

    def _publish_handshake(self) -> None:
        if self._not_alone():
            self._handshake.cancel()
            self._leaving.at_once(BAD_INPUT)
            return
        self._publish_clock(self.playback.start_ns)
        for topic, (channels, units) in self.playback.channels.items():
            self._out[topic].publish(empty_block(channels, units))
        self._events.publish_handshake()

    def _start(self) -> None:
        self._started = self._played_at = time.monotonic()
        seconds = self.playback.seconds
        paced = f"at {self._rate:g} x real time" if self._rate else "as fast as it is answered"
        text = f"replaying {self._bag.name}: {seconds:g} s {paced}"
        self._events.publish(Event.INFO, Event.STARTED, text, seconds, time_of(self.playback.start_ns))
        self._turn_timer.reset()
        if not self._rate:
            self._next_block()

    def _not_alone(self) -> bool:
        """Whether another node feeds the loop too; logs it."""
        if started_twice(self):
            return True
        for topic, kind in self.playback.topics.items():
            if kind == BLOCK and self.count_publishers(topic) > 1:
                self.get_logger().error(f"{topic} is being published by another node: stop it before a replay")
                return True
        return False

    # the loop

    def _on_answer(self, message: CeilingCommand | Excitation) -> None:
        if message.handshake:
            self._handshake.on_answer(message)
            return
        if self._awaited is not None and nanoseconds_of(message.header.stamp) >= self._awaited - _SAME_INSTANT:
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
        """Play what is due, where the replay is paced; check that answers arrive."""
        now = time.monotonic()
        if self._rate:
            bag_ns = self.playback.start_ns + round((now - self._started) * self._rate * 1e9)
            self._publish_clock(bag_ns)
            while self.played < len(self.playback.items) and self.playback.items[self.played].time_ns <= bag_ns:
                self._play(self.playback.items[self.played])
            if self.played == len(self.playback.items) and self._awaited is None:
                self._end()
        if self._awaited is not None and now - self._played_at > _TIMEOUT:
            self._played_at = now
            at = f"the block that ends at {(self._awaited - self.playback.start_ns) * 1e-9:.3f} s"
            self.get_logger().warning(f"no {self._answer} answers {at}: check that its nodes are running")

    def _play(self, item: Item) -> None:
        self.played += 1
        if item.answer_ns is not None:
            # before publishing: in one process the answer may come back at once
            self._awaited, self._played_at = item.answer_ns, time.monotonic()
        self._out[item.topic].publish(item.data)

    def _publish_clock(self, nanoseconds: int) -> None:
        self._clock_out.publish(ClockMessage(clock=time_of(nanoseconds)))

    # the end

    def _end(self) -> None:
        """Publish the end of the bag, wait until the recorder has closed its own, and end."""
        if self._leaving.status is not None:
            return
        wall = max(time.monotonic() - self._started, 1e-9)
        seconds = self.playback.seconds
        text = f"{seconds:g} s replayed in {wall:.2f} s ({seconds / wall:.1f} x real time)"
        self._turn_timer.cancel()
        self._events.publish(Event.INFO, Event.FINISHED, text, seconds, time_of(self.playback.last_stamp_ns))
        self._leaving.when_recorded(DONE)

    def _statuses(self) -> list[DiagnosticStatus]:
        waiting = self._handshake.waiting_for() if self._handshake.active else ""
        ended = self._leaving.status is not None
        values = {
            "bag": self._bag,
            "played [messages]": f"{self.played} of {len(self.playback.items)}",
            "rate [-]": self._rate,
            "converted types": len(self.playback.notes),
        }
        message = f"waiting for {waiting}" if waiting else "ended" if ended else "playing"
        return [diagnostic_status(self, "replay", DiagnosticStatus.OK, message, values)]

    def close(self) -> None:
        """Stop the timers."""
        self._handshake.cancel()
        self._turn_timer.cancel()
        self._recorder.cancel()
        self._diagnostics.cancel()


main = partial(run_node, ReplayNode)

if __name__ == "__main__":
    sys.exit(main())
