# SPDX-License-Identifier: Apache-2.0
"""Records the graph's topics to a bag; serialised messages go from the wire to the file without being decoded."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from atpid_interfaces.msg import Event, RecorderStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import STATUS, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.single_instance import StartedTwiceError, check_alone
from atpid_control.recording import BagError, Qos, check_new, new_run
from atpid_control.recording.definitions import split_name
from atpid_control.recording.session import Session
from atpid_control.recording.topics import DEFAULT, Topic, parse
from atpid_control.recording.writer import CHUNK, COMPRESSIONS
from atpid_sim.scene import load_scene

BAD_INPUT = 2
#: Messages kept per topic while the recorder is busy: 50 s of blocks at 20 a second.
DEPTH = 1000
TURN = 0.05  # how often the recorder looks whether the run has ended [s]

PARAMETERS: tuple[tuple[str, Any, str], ...] = (
    ("bag", "", "folder to make; empty: run-<id> in the current folder"),
    ("scene", "", "scene file, kept in the bag word for word; empty: none"),
    ("files", [""], "further configuration files to keep in the bag word for word"),
    ("run_id", "", "name of the run; empty: date, time and a random part"),
    ("commit", "", "version of the code; empty: asked from git"),
    ("lockstep", False, "true: log times are the messages' stamps and the order is theirs; false: as received"),
    ("topics", list(DEFAULT), "what to record: 'name pkg/msg/Type', then best_effort or transient_local where needed"),
    ("compression", "zstd", "compression of chunks: zstd, lz4 or none"),
)


class RecorderNode(Node):
    """Parameters, topics, and one call into the session for each message."""

    def __init__(self, *, parameter_overrides: list[Parameter] | None = None, **node_options: Any) -> None:
        """Check what is asked for; the bag is made on the executor's first turn. Raises BagError."""
        super().__init__("recorder_node", parameter_overrides=parameter_overrides, **node_options)
        self._declare()
        self._lockstep = bool(self._value("lockstep"))
        self.topics = [self._resolved(topic) for topic in parse(self._value("topics"), self._lockstep)]
        files = [Path(name) for name in self._value("files") if name]
        scene = Path(self._value("scene")) if self._value("scene") else None
        clock = "lockstep" if self._lockstep else "real time"
        self.run = new_run(scene, files, self._value("run_id"), self._value("commit"), clock=clock)
        self._chunk = self._value("chunk") or (load_scene(scene).recording.chunk if scene else CHUNK)
        self.bag = Path(self._value("bag") or f"run-{self.run.id}").absolute()
        check_new(self.bag)
        self.session: Session | None = None
        self.done: Future = Future()
        self.error = ""
        self._make_topics()

    def _declare(self) -> None:
        for name, default, text in PARAMETERS:
            self.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=True))
        chunk = IntegerRange(from_value=0, to_value=16_777_216)
        text = "size of a chunk [bytes]: what a crash can lose; 0: as the scene says"
        described = ParameterDescriptor(description=text, read_only=True, integer_range=[chunk])
        self.declare_parameter("chunk", 0, described)
        text = "how often the disk is told to have everything [s]: what a power cut can lose; 0: never"
        self.declare_parameter("sync_period", 1.0, ParameterDescriptor(description=text, read_only=True))
        if self._value("compression") not in COMPRESSIONS:
            raise BagError(
                f"parameter compression: given {self._value('compression')!r}; allowed: {', '.join(COMPRESSIONS)}"
            )

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _resolved(self, topic: Topic) -> Topic:
        return Topic(self.resolve_topic_name(topic.name), topic.type, topic.best_effort, topic.transient_local)

    def _make_topics(self) -> None:
        self._status = self.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self._events = EventPublisher(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        for topic in self.topics:
            self.create_subscription(
                _class_of(topic.type),
                topic.name,
                partial(self._on_message, topic.name),
                _qos_for(topic),
                raw=True,
            )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers = [
            self.create_timer(TURN, self._turn, clock=steady),
            self.create_timer(1.0, self._each_second, clock=steady),
        ]
        if self._value("sync_period") > 0.0:
            self._timers.append(self.create_timer(self._value("sync_period"), self._sync, clock=steady))

    # recording

    def _open(self) -> Session:
        """Make the bag with the first message or turn, so that a node refused before leaves nothing behind."""
        if self.session is None:
            self.session = Session(
                self.bag, self.run, self.topics, lockstep=self._lockstep, offered=self._offered,
                chunk=self._chunk, compression=self._value("compression"),
            )  # fmt: skip
            self.get_logger().info(f"recording {len(self.topics)} topics to {self.bag}")
            self._publish_status()
        return self.session

    def _on_message(self, topic: str, data: bytes) -> None:
        if self.error:
            return
        try:
            session = self._open()
            missing = session.receive(topic, data, self.get_clock().now().nanoseconds)
        except BagError as error:
            self._fail(error)
            return
        if session.received[topic] == 1:
            self._publish_status()
        if missing:
            self._tell(
                Event.WARNING,
                Event.DROPPED,
                float(missing),
                f"{missing} scans missing on {topic}: lost before the recorder",
            )

    def _turn(self) -> None:
        if self.error:
            return
        try:
            if self._open().complete:
                self._finish()
        except BagError as error:
            self._fail(error)

    def _finish(self) -> None:
        """Close the bag; the node stays, so that whoever waits for its status gets it."""
        if self.session is None or not self.session.recording:
            return
        late = self.session.missing_topics()
        self.session.close()
        count = sum(self.session.written.values())
        self.get_logger().info(f"closed {self.bag}: {count} messages")
        if late:
            self.get_logger().warning(f"the run has finished but {', '.join(late)} did not come to its end")
        self._publish_status()

    def _sync(self) -> None:
        if self.session is None or self.error:
            return
        try:
            self.session.sync()
        except BagError as error:
            self._fail(error)

    def _fail(self, error: BagError) -> None:
        self.error = str(error)
        self._tell(Event.ALARM, Event.FAULT, float("nan"), self.error)
        self._publish_status()
        if not self.done.done():
            self.done.set_result(BAD_INPUT)

    def _offered(self, topic: str) -> tuple[Qos, ...]:
        """Quality of service of the publishers discovered; that of the subscription where none is."""
        profiles = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        return tuple(dict.fromkeys(_words(profile) for profile in profiles)) or (Qos(depth=DEPTH),)

    # what it says

    def _publish_status(self) -> None:
        if not self.context.ok():
            return
        message = RecorderStatus(recording=self.session is not None and self.session.recording, bag=str(self.bag))
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = self.get_name()
        message.topics = [topic.name for topic in self.topics]
        if self.session is not None:
            message.received, message.written = (
                list(self.session.received.values()),
                list(self.session.written.values()),
            )
        else:
            message.received = message.written = [0] * len(self.topics)
        self._status.publish(message)

    def _tell(self, severity: int, kind: str, value: float, text: str) -> None:
        newest = self.session.newest_ns if self.session is not None and self._lockstep else None
        self._events.publish(severity, kind, text, value, None if newest is None else time_of(newest))

    def _each_second(self) -> None:
        try:
            check_alone(self)
        except StartedTwiceError as error:
            self.get_logger().error(str(error))
        self._publish_status()
        self._diagnostics.publish(self._diagnosis())

    def _diagnosis(self) -> DiagnosticArray:
        session = self.session
        lost = sum(flow.lost for flow in session.continuity.values()) if session else 0
        level = DiagnosticStatus.ERROR if self.error else DiagnosticStatus.WARN if lost else DiagnosticStatus.OK
        recording = session is not None and session.recording
        status = DiagnosticStatus(level=level, name=self.get_name(), hardware_id=str(self.bag))
        status.message = self.error or (f"{lost} scans lost" if lost else "recording" if recording else "closed")
        facts = {
            "messages": sum(session.written.values()) if session else 0,
            "bytes": session.writer.size if session else 0,
            "backlog": session.waiting if session else 0,
            "lost scans": lost,
            "last error": self.error,
        }
        status.values = [KeyValue(key=key, value=str(value)) for key, value in facts.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        return message

    def close(self) -> None:
        """Close the bag, whatever happened: this is what Ctrl-C comes to."""
        for timer in self._timers:
            timer.cancel()
        try:
            self._finish()
        except BagError as error:
            self.error = str(error)
            self.get_logger().error(self.error)


def _class_of(name: str) -> type[Any]:
    package, message = split_name(name)
    found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), message)
    return found


def _qos_for(topic: Topic) -> QoSProfile:
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if topic.best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local else DurabilityPolicy.VOLATILE,
    )


def _words(profile: QoSProfile) -> Qos:
    """Return a profile in words; DDS does not announce history and depth, so the recorder's own stand in."""
    known = profile.history in (HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL)
    return Qos(
        depth=profile.depth or DEPTH,
        reliability=profile.reliability.short_key,
        durability=profile.durability.short_key,
        history=profile.history.short_key if known else "keep_last",
        deadline_ns=profile.deadline.nanoseconds,
        lifespan_ns=profile.lifespan.nanoseconds,
        liveliness=profile.liveliness.short_key,
        lease_ns=profile.liveliness_lease_duration.nanoseconds,
    )


def main(args: Sequence[str] | None = None) -> int:
    """Run the recorder as a process of its own; return the exit status."""
    return run_node(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
