# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records the graph's topics to a bag; serialised messages are written as they are received."""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import yaml
from atpid_interfaces.msg import Event, RecorderStatus
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.errors import BAD_INPUT
from atpid_common.nodes.checked import Dropped
from atpid_common.nodes.diagnostics import DiagnosticsPublisher
from atpid_common.nodes.diagnostics import status as diagnostic_status
from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import STATUS, STEADY, time_of
from atpid_common.nodes.node_main import run_node
from atpid_common.nodes.parameters import declare
from atpid_common.nodes.single_instance import started_twice
from atpid_common.parameters import Values
from atpid_common.real_time import LOOP_PRIORITY
from atpid_control.nodes.bag_qos import DEPTH, class_of, qos_of, subscription_qos
from atpid_control.nodes.recorder_parameters import PARAMETERS, ParameterReader, writing_of
from atpid_control.recording.session import DiskWatch, RecordingSession
from atpid_control.recording.trigger import PreTrigger
from atpid_control.runs.errors import BagError, MessageError
from atpid_control.runs.metadata import Qos, new_run
from atpid_control.runs.topics import parse
from atpid_control.runs.writer import Sink, check_new

_TURN = 0.05  # between two checks whether the run has ended, and which parameters are still unknown [s]
_STATUS_PERIOD = 1.0  # [s]
#: How long messages gather, which a kill loses beside those of the chunk [s].
GATHER = 0.01
#: Writing that takes longer is reported, and that for so long none did: at least and, where it comes back, at most [s].
_SLOW_WRITE, _DISK_WELL = 0.4, (2.0, 60.0)


class RecorderNode(Node):
    """Parameters, topics, and one call into the session for each message."""

    def __init__(self, **node_options: object) -> None:
        """Check the parameters; the bag is made on the executor's first turn. Raises BagError, ParameterError."""
        super().__init__("recorder_node", **node_options)
        self._values = declare(self, PARAMETERS)
        self._lockstep = bool(self._values["lockstep"])
        self._chunk_period = 0.0 if self._lockstep else float(self._values["chunk_period"])
        chosen = parse(self._values["topics"], self._lockstep)
        self.topics = [replace(topic, name=self.resolve_topic_name(topic.name)) for topic in chosen]
        files = [Path(name) for name in self._values["files"] if name]
        scene = Path(self._values["scene"]) if self._values["scene"] else None
        self._disk = DiskWatch(_SLOW_WRITE, *_DISK_WELL)
        clock = "lockstep" if self._lockstep else "real time"
        facts = {"clock": clock} if self._lockstep else {"clock": clock, "chunk_period": f"{self._chunk_period:g}"}
        self.run = new_run(scene, files, self._values["run_id"], self._values["commit"], **facts)
        self._writing = writing_of(self._values, self.topics, scene)
        self.bag = Path(self._values["bag"] or f"run-{self.run.id}").absolute()
        check_new(self.bag)
        self.session: RecordingSession | None = None
        self.done: Future = Future()
        self.error = ""
        self._received = self._chunk_ended = time.monotonic()  # the last message, the last chunk [s]
        self._triggered = self._complained = False
        self._make_topics()

    def _make_topics(self) -> None:
        self._status = self.create_publisher(RecorderStatus, "recorder/status", STATUS)
        self._events = EventPublisher(self)
        self._diagnostics = DiagnosticsPublisher(self, self._statuses)
        for topic in self.topics:
            take = partial(self._on_message, topic.name)
            self.create_subscription(class_of(topic.type), topic.name, take, subscription_qos(topic), raw=True)
        nodes = [] if self._lockstep else [name for name in self._values["parameters_of"] if name]
        reader = ParameterReader(self, nodes, self._keep_parameters)
        self._own_timers = [
            self.create_timer(_TURN, partial(self._guarded, self._turn), clock=STEADY),
            self.create_timer(_TURN, reader.poll, clock=STEADY),
            self.create_timer(_STATUS_PERIOD, self._each_second, clock=STEADY),
        ]
        for period, act in ((self._values["sync_period"], self._sync), (self._chunk_period, self._end_chunk)):
            if period > 0.0:
                self._own_timers.append(self.create_timer(period, partial(self._guarded, act), clock=STEADY))

    # recording

    def _open(self) -> RecordingSession:
        """Make the bag with the first message or turn, so that a node with bad parameters makes no bag."""
        if self.session is None:
            self.session = RecordingSession(
                self.bag,
                self.run,
                self.topics,
                lockstep=self._lockstep,
                offered=self._offered,
                writing=self._writing,
                sink=self._sink,
            )
            waits = f" from the trigger on ({self._values['trigger']})" if self.session.waiting else ""
            self.get_logger().info(f"recording {len(self.topics)} topics to {self.bag}{waits}")
            self._publish_status()
        return self.session

    def _sink(self, path: Path) -> Sink:
        """Open a file of the bag."""
        return Sink(path)

    def _on_message(self, topic: str, data: bytes, info: dict[str, int]) -> None:
        if self.error:
            return
        self._received = time.monotonic()
        # by the middleware, whose thread no writing or syncing holds up
        simulated = bool(self.get_parameter("use_sim_time").value)
        received_ns = (0 if simulated else info["received_timestamp"]) or int(self.get_clock().now().nanoseconds)
        try:
            session = self._open()
            missing = session.receive(topic, data, received_ns)
            if 0.0 < self._chunk_period <= time.monotonic() - self._chunk_ended:  # its timer waits its turn
                self._end_chunk()
            self._judge_disk(time.monotonic() - self._received, "writing")
        except MessageError as error:
            Dropped.of(self).add(topic, str(error))
            return
        except BagError as error:
            self._fail(error)
            return
        if session.received[topic] == 1:
            self._publish_status()
        if session.waiting is not None and not self._triggered:
            self._follow_trigger(session.waiting)
        if missing:
            text = f"{missing} scans missing on {topic}: lost before the recorder"
            self._publish_event(Event.WARNING, Event.DROPPED, text, float(missing))

    def _follow_trigger(self, waiting: PreTrigger) -> None:
        """Report the trigger, or why there can be none; in lockstep, where events are part of the run, in the log."""
        if waiting.complaint and not self._complained:
            self._complained = True
            self._publish_event(Event.WARNING, Event.TRIGGER, waiting.complaint)
        if waiting.fired is None or self.session is None:
            return
        self._triggered = True
        if self._lockstep:
            self.get_logger().info(self.session.trigger_line)
        else:
            severity = Event.WARNING if waiting.shortened else Event.INFO
            self._publish_event(severity, Event.TRIGGER, self.session.trigger_line, waiting.fired.value)

    def _guarded(self, act: Callable[[], None]) -> None:
        """Call `act` unless the recording has failed; an error of the bag ends it."""
        if self.error:
            return
        try:
            act()
        except BagError as error:
            self._fail(error)

    def _judge_disk(self, took: float, what: str) -> None:
        """Report a disk that is slow; not in lockstep, whose events depend on the run alone."""
        slow = self._disk.push(took, time.monotonic())
        if slow is None or self._lockstep:
            return
        if slow:
            cost = "a power cut loses as much" if what == "flushing" else f"messages wait, {DEPTH} of a topic at most"
            self._publish_event(Event.WARNING, Event.SLOW, f"{what} {self.bag} takes {took:.2f} s: {cost}", took)
        else:
            self._publish_event(Event.INFO, Event.RECOVERED, f"{self.bag} is written without delay again")

    def _turn(self) -> None:
        session = self._open()
        self._judge_disk(session.writer.flush_seconds, "flushing")
        if session.complete:
            self._finish()

    def _finish(self) -> None:
        """Close the bag; the node stays, so that its status is still published."""
        if self.session is None or not self.session.recording:
            return
        late = self.session.missing_topics()
        self.session.close()
        count = sum(self.session.written.values())
        self.get_logger().info(f"closed {self.bag}: {count} messages")
        if self.session.waiting is not None and self.session.waiting.fired is None:
            self.get_logger().warning(f"the trigger has not come, nothing was recorded: {self.session.trigger_line}")
        if late:
            self.get_logger().warning(f"the run has finished but {', '.join(late)} did not reach its end")
        self._publish_status()

    def _sync(self) -> None:
        if self.session is not None:
            self.session.sync()

    def _end_chunk(self) -> None:
        self._chunk_ended = time.monotonic()
        if self.session is not None:
            self.session.end_chunk()

    def _keep_parameters(self, name: str, values: Values) -> None:
        text = yaml.safe_dump({f"/**/{name}": {"ros__parameters": values}}, sort_keys=False)
        self._guarded(lambda: self._open().keep(f"{name}.yaml", text.encode()))

    def _fail(self, error: BagError) -> None:
        self.error = str(error)
        self._publish_event(Event.ALARM, Event.FAULT, self.error)
        self._publish_status()
        if not self.done.done():
            self.done.set_result(BAD_INPUT)

    def _offered(self, topic: str) -> tuple[Qos, ...]:
        """Quality of service of the publishers discovered; that of the subscription where none is."""
        profiles = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        return tuple(dict.fromkeys(qos_of(profile) for profile in profiles)) or (Qos(depth=DEPTH),)

    # publishing

    def _publish_status(self) -> None:
        if not self.context.ok():
            return
        session = self.session
        message = RecorderStatus(recording=session is not None and session.recording, bag=str(self.bag))
        message.header.stamp = self.get_clock().now().to_msg()
        message.topics = [topic.name for topic in self.topics]
        nothing = dict.fromkeys(message.topics, 0)
        message.received = list((session.received if session else nothing).values())
        message.written = list((session.written if session else nothing).values())
        self._status.publish(message)

    def _publish_event(self, severity: int, kind: str, text: str, value: float = float("nan")) -> None:
        newest = self.session.newest_ns if self.session is not None and self._lockstep else None
        self._events.publish(severity, kind, text, value, None if newest is None else time_of(newest))

    def _each_second(self) -> None:
        started_twice(self)
        self._publish_status()

    def _statuses(self) -> list[DiagnosticStatus]:
        session = self.session
        lost = sum(flow.lost for flow in session.continuity.values()) if session else 0
        level = DiagnosticStatus.ERROR if self.error else DiagnosticStatus.WARN if lost else DiagnosticStatus.OK
        recording = session is not None and session.recording
        message = self.error or (f"{lost} scans lost" if lost else "recording" if recording else "closed")
        values = {
            "bag": self.bag,
            "messages": sum(session.written.values()) if session else 0,
            "size [bytes]": session.writer.size if session else 0,
            "waiting for their place [messages]": len(session.order) if session else 0,
            "last message [s ago]": f"{time.monotonic() - self._received:.1f}",
            "lost scans": lost,
            "longest write [s]": f"{self._disk.longest:.2f}",
            "last error": self.error or "none",
        }
        return [diagnostic_status(self, "recording", level, message, values)]

    def close(self) -> None:
        """Close the bag, after Ctrl-C and after an error too."""
        self._diagnostics.cancel()
        for timer in self._own_timers:
            timer.cancel()
        try:
            self._finish()
        except BagError as error:
            self.error = str(error)
            self.get_logger().error(self.error)


main = partial(run_node, RecorderNode, priority=LOOP_PRIORITY, gather=GATHER)

if __name__ == "__main__":
    sys.exit(main())
