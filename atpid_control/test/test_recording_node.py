# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recorder among real publishers: handshake, order, ends of every kind."""

import errno
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from ament_index_python.packages import get_package_prefix
from atpid_interfaces.msg import (
    CeilingCommand,
    CeilingState,
    Event,
    Excitation,
    PlantTruth,
    RecorderStatus,
    SampleBlock,
)
from mcap.records import Attachment
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from atpid_common.nodes.events import EventPublisher
from atpid_common.nodes.messages import BLOCKS, EVENTS_KEPT, STATUS, time_of
from atpid_common.nodes.parameters import ParameterError
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.nodes.recorder_node import RecorderNode
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import find_parts
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import records
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import Sink

TOPICS: dict[str, type[Any]] = {
    "sensors/laser": SampleBlock,
    "plant/truth": PlantTruth,
    "excitation": Excitation,
    "ceiling/command": CeilingCommand,
    "ceiling/state": CeilingState,
    "events": Event,
}
BY_CLOCK = {"/rosout", "/diagnostics"}
BLOCK_NS, SCANS = 50_000_000, 50


class Source(Node):  # type: ignore[misc]
    """Publishes a run's messages and receives the recorder's status."""

    def __init__(self) -> None:
        super().__init__("source")
        self.out = {
            topic: self.create_publisher(kind, topic, EVENTS_KEPT if kind is Event else BLOCKS)
            for topic, kind in TOPICS.items()
        }
        self.status: RecorderStatus | None = None
        self.kinds: list[str] = []
        self.create_subscription(RecorderStatus, "recorder/status", self._on_status, STATUS)
        self.create_subscription(Event, "events", lambda event: self.kinds.append(event.kind), BLOCKS)

    def _on_status(self, status: RecorderStatus) -> None:
        self.status = status

    def say(self, topic: str, stamp_ns: int, **fields: Any) -> None:
        message = TOPICS[topic](**fields)
        message.header.stamp = time_of(stamp_ns)
        self.out[topic].publish(message)

    def handshake(self) -> None:
        for topic in TOPICS:
            self.say(topic, 0, handshake=True)

    def ready(self) -> bool:
        """Whether the recorder has received every topic; repeats the handshake where it has not."""
        counts = dict(zip(self.status.topics, self.status.received, strict=True)) if self.status else {}
        if all(counts.get(f"/{topic}", 0) for topic in TOPICS):
            return True
        self.handshake()
        return False

    def block(self, number: int) -> None:
        last = number * BLOCK_NS + 49_000_000
        shape: dict[str, Any] = {"first_index": number * SCANS, "rate": 1000.0}
        # in the wrong order on purpose
        self.say("ceiling/state", last)
        self.say("plant/truth", number * BLOCK_NS, **shape, support=[0.0] * SCANS)
        self.say("excitation", last)
        channels: dict[str, Any] = {"channels": ["a"], "units": ["m"], "skew": [0.0]}
        self.say("sensors/laser", number * BLOCK_NS, **shape, **channels, data=[float(number)] * SCANS)
        self.say("ceiling/command", last)

    def finish(self, blocks: int) -> None:
        self.say("events", blocks * BLOCK_NS - 1_000_000, kind="finished")

    def closed(self) -> bool:
        return self.status is not None and not self.status.recording and sum(self.status.written) > 0


@pytest.fixture
def ros() -> Iterator[TurnExecutor]:
    rclpy.init()
    executor = TurnExecutor()
    yield executor
    for node in executor.get_nodes():
        getattr(node, "close", lambda: None)()
        node.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown()


def spin_until(executor: TurnExecutor, met: Callable[[], bool], timeout: float = 100.0) -> None:
    deadline = time.monotonic() + timeout
    while not met():
        assert time.monotonic() < deadline, "what the test waits for did not happen"
        executor.spin_once(timeout_sec=0.05)


def make(executor: TurnExecutor, bag: Path, **parameters: Any) -> tuple[RecorderNode, Source]:
    overrides = [Parameter(name, value=value) for name, value in {"bag": str(bag), **parameters}.items()]
    recorder, source = RecorderNode(parameter_overrides=overrides), Source()
    executor.add_node(recorder)
    executor.add_node(source)
    return recorder, source


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_run_is_recorded_from_handshake_to_finished(ros: TurnExecutor, tmp_path: Path, lockstep: bool) -> None:
    recorder, source = make(ros, tmp_path / "run", lockstep=lockstep)
    spin_until(ros, source.ready)
    for number in range(30):
        source.block(number)
        ros.spin_once(timeout_sec=0.0)
    source.finish(30)
    spin_until(ros, source.closed)
    found = verify(tmp_path / "run")
    of_the_run = {topic: count for topic, count in found.by_topic.items() if topic not in BY_CLOCK}
    assert of_the_run == {**dict.fromkeys((f"/{topic}" for topic in TOPICS), 30), "/events": 1}
    assert (set(found.by_topic) & BY_CLOCK == set()) == lockstep
    bag = open_bag(tmp_path / "run")
    assert not any(message.handshake for _, message in bag.messages("/sensors/laser"))
    if lockstep:
        assert (found.start_ns, found.end_ns) == (0, 29 * BLOCK_NS + 49_000_000)
        order = [raw.topic for raw in bag.raw][:5]
        assert order == ["/sensors/laser", "/plant/truth", "/excitation", "/ceiling/command", "/ceiling/state"]
    else:
        assert abs(found.end_ns - time.time_ns()) < 60e9
    assert bag.result["finished"] == "yes"
    assert bag.result["lost_scans /sensors/laser"] == "0"
    assert not recorder.error


def test_a_strangers_end_does_not_end_the_record(ros: TurnExecutor, tmp_path: Path) -> None:
    recorder, source = make(ros, tmp_path / "run")
    spin_until(ros, source.ready)
    source.say("events", 0, kind="started", node="plant_node")
    for number in range(30):
        source.block(number)
        if number == 10:
            source.say("events", 10 * BLOCK_NS, kind="finished", node="a stranger")
        ros.spin_once(timeout_sec=0.0)
    source.say("events", 30 * BLOCK_NS - 1_000_000, kind="finished", node="plant_node")
    spin_until(ros, source.closed)
    assert verify(tmp_path / "run").by_topic["/sensors/laser"] == 30
    assert not recorder.error


def test_missing_scans_are_announced_and_recorded(ros: TurnExecutor, tmp_path: Path) -> None:
    _, source = make(ros, tmp_path / "run")
    spin_until(ros, source.ready)
    for number in (0, 1, 3):
        source.block(number)
    spin_until(ros, lambda: "dropped" in source.kinds)
    source.finish(4)
    spin_until(ros, source.closed)
    bag = open_bag(tmp_path / "run")
    assert bag.result["lost_scans /sensors/laser"] == "50"
    assert [event.value for _, event in bag.messages("/events") if event.kind == "dropped"] == [50.0]


@pytest.mark.slow
def test_a_topic_that_stays_behind_does_not_keep_the_bag_open(ros: TurnExecutor, tmp_path: Path) -> None:
    recorder, source = make(ros, tmp_path / "run")
    spin_until(ros, source.ready)
    source.block(0)
    source.say("sensors/laser", BLOCK_NS, first_index=SCANS, rate=1000.0, channels=["a"], data=[0.0] * SCANS)
    source.finish(2)
    spin_until(ros, source.closed)
    assert recorder.session is not None
    assert recorder.session.missing_topics() == ["/plant/truth", "/excitation", "/ceiling/command", "/ceiling/state"]


def test_a_full_disk_ends_the_recording_with_one_line(
    ros: TurnExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder, source = make(ros, tmp_path / "run", sync_period=0.0)
    spin_until(ros, source.ready)

    def full(_sink: Sink, _data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Sink, "write", full)
    for number in range(60):
        source.block(number)
    spin_until(ros, lambda: "fault" in source.kinds)
    assert recorder.done.result() == 2
    assert "the disk is full" in recorder.error
    assert "recover" in recorder.error
    spin_until(ros, lambda: source.status is not None and not source.status.recording)
    assert source.kinds.count("fault") == 1


def test_a_disk_that_hangs_is_reported_and_nothing_waits_for_it(
    ros: TurnExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    monkeypatch.setattr(Sink, "sync", lambda _sink: released.wait(100.0))
    recorder, source = make(ros, tmp_path / "run", sync_period=0.05)
    try:
        spin_until(ros, source.ready)
        source.block(0)
        spin_until(ros, lambda: "slow" in source.kinds)
        source.block(1)
        session = recorder.session
        assert session is not None
        spin_until(ros, lambda: session.written["/sensors/laser"] == 2)
        assert not recorder.error
    finally:
        released.set()
    source.finish(2)
    spin_until(ros, source.closed)
    slow = [event.text for _, event in open_bag(tmp_path / "run").messages("/events") if event.kind == "slow"]
    assert len(slow) == 1
    assert "a power cut loses as much" in slow[0]


def test_an_existing_bag_is_refused_before_anything_is_made(ros: TurnExecutor, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(BagError, match="exists already"):
        make(ros, tmp_path / "run")
    with pytest.raises(ParameterError, match="compression of recorder_node: given 'gzip'; allowed: 'zstd'"):
        make(ros, tmp_path / "other", compression="gzip")
    assert not (tmp_path / "other").exists()


class Process:
    """recorder_node as `ros2 run` starts it."""

    def __init__(self, folder: Path, *parameters: str) -> None:
        executable = Path(get_package_prefix("atpid_control")) / "lib/atpid_control/recorder_node"
        given = [part for name in (f"bag:={folder}", *parameters) for part in ("-p", name)]
        self.process = subprocess.Popen(
            [executable, "--ros-args", *given], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    def end(self, number: int | None = None) -> tuple[int, str]:
        if number is not None:
            self.process.send_signal(number)
        said, _ = self.process.communicate(timeout=100.0)
        return self.process.returncode, said


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_end_by_a_signal_leaves_a_whole_bag(ros: TurnExecutor, tmp_path: Path, number: int) -> None:
    """What a kill leaves: test_recording_killed.py."""
    recorder, source = Process(tmp_path / "run", "sync_period:=0.05"), Source()
    ros.add_node(source)
    try:
        spin_until(ros, source.ready)
        for block in range(20):
            source.block(block)
        spin_until(ros, lambda: source.status is not None and min(source.status.written[:1]) >= 20)
        status, said = recorder.end(number)
    finally:
        recorder.process.kill()
        recorder.process.wait()
    assert status == 0, said
    assert verify(tmp_path / "run").by_topic["/sensors/laser"] == 20


@pytest.mark.slow
def test_bad_input_is_one_line_and_status_2(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    status, said = Process(tmp_path / "run").end()
    assert status == 2
    assert said.count("\n") == 1
    assert "exists already" in said


@pytest.mark.slow
def test_a_second_recorder_leaves_nothing_behind(ros: TurnExecutor, tmp_path: Path) -> None:
    first, source = Process(tmp_path / "first"), Source()
    ros.add_node(source)
    try:
        spin_until(ros, source.ready)
        status, said = Process(tmp_path / "second").end()
        assert status == 2
        assert "already running" in said
        assert not (tmp_path / "second").exists()
        assert first.end(signal.SIGINT)[0] == 0
    finally:
        first.process.kill()
        first.process.wait()
    assert set(verify(tmp_path / "first").by_topic) <= {"/diagnostics", "/rosout", "/events"}  # its own
    assert os.listdir(tmp_path) == ["first"]


def test_an_event_from_before_the_recorder_is_in_the_bag_once(ros: TurnExecutor, tmp_path: Path) -> None:
    early = Node("motor_node")
    ros.add_node(early)
    events = EventPublisher(early)
    events.publish(Event.ALARM, Event.FAULT, "motor off: no answer")
    for _ in range(2 * EVENTS_KEPT.depth):  # a source that waits for long must not displace it
        events.publish_handshake()
    recorder, source = make(ros, tmp_path / "run")
    spin_until(ros, source.ready)
    spin_until(ros, lambda: recorder.session is not None and recorder.session.written["/events"] > 0)
    source.block(0)
    source.finish(1)
    spin_until(ros, source.closed)
    kept = [(event.kind, event.text) for _, event in open_bag(tmp_path / "run").messages("/events")]
    assert kept == [("fault", "motor off: no answer"), ("finished", "")]
    early.destroy_node()


def test_the_end_is_that_of_a_source_not_of_anybody(ros: TurnExecutor, tmp_path: Path) -> None:
    recorder, source = make(ros, tmp_path / "run")
    spin_until(ros, source.ready)
    source.say("events", 0, node="plant_node", kind=Event.STARTED)
    source.block(0)
    source.say("events", BLOCK_NS, node="somebody", kind=Event.FINISHED)
    spin_until(ros, lambda: recorder.session is not None and recorder.session.written["/events"] == 2)
    source.block(1)
    spin_until(ros, lambda: recorder.session is not None and recorder.session.written["/ceiling/command"] == 2)
    source.say("events", 2 * BLOCK_NS - 1_000_000, node="plant_node", kind=Event.FINISHED)
    spin_until(ros, source.closed)
    assert verify(tmp_path / "run").by_topic["/sensors/laser"] == 2


@pytest.mark.slow
def test_log_transitions_and_parameters_are_kept_and_read_elsewhere(ros: TurnExecutor, tmp_path: Path) -> None:
    motor = LifecycleNode("motor_node")
    motor.declare_parameter("speed", 0.3)
    motor.declare_parameter("limits", [0.017, 1.0])
    ros.add_node(motor)
    recorder, source = make(ros, tmp_path / "run")

    def recorded() -> bool:
        session = recorder.session
        return session is not None and session.written["/motor_node/transition_event"] > 0

    spin_until(ros, source.ready)
    spin_until(ros, lambda: motor.count_subscribers("motor_node/transition_event") > 0)
    motor.trigger_configure()
    motor.get_logger().warning("the belt slips")
    spin_until(ros, recorded)
    spin_until(ros, lambda: "motor_node.yaml" in kept_files(tmp_path / "run"))
    source.block(0)
    source.finish(1)
    spin_until(ros, source.closed)
    bag = open_bag(tmp_path / "run")
    logs = [message.msg for _, message in bag.messages("/rosout") if message.name == "motor_node"]
    assert "the belt slips" in logs
    goals = [message.goal_state.label for _, message in bag.messages("/motor_node/transition_event")]
    assert goals[-1] == "inactive"
    assert yaml.safe_load(bag.files["motor_node.yaml"]) == {
        "/**/motor_node": {"ros__parameters": {"speed": 0.3, "limits": [0.017, 1.0]}}
    }
    verify(tmp_path / "run")
    with AnyReader([tmp_path / "run"], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        names = {
            connection.msgtype
            for connection, _, data in reader.messages()
            if reader.deserialize(data, connection.msgtype)
        }
    assert {"rcl_interfaces/msg/Log", "lifecycle_msgs/msg/TransitionEvent"} <= names
    motor.destroy_node()


def kept_files(folder: Path) -> list[str]:
    """Names of the files kept in a bag that is still being written."""
    return [record.name for record in records(find_parts(folder)[0], torn_ok=True) if isinstance(record, Attachment)]


def test_a_trigger_among_real_publishers(ros: TurnExecutor, tmp_path: Path) -> None:
    overrides = {"trigger": "sensors/laser a", "trigger_level": 19.5, "trigger_pre": 0.1, "trigger_post": 0.2}
    recorder, source = make(ros, tmp_path / "run", lockstep=True, **overrides)
    spin_until(ros, source.ready)
    for number in range(40):
        source.block(number)
        ros.spin_once(timeout_sec=0.0)
    spin_until(ros, source.closed)  # by itself, the run goes on
    bag = open_bag(tmp_path / "run")
    # block 20 is the first above the level: two blocks before it end in the pre-trigger time
    assert [block.first_index // SCANS for _, block in bag.messages("/sensors/laser")] == [18, 19, 20, 21, 22, 23, 24]
    assert bag.result["trigger"].startswith("/sensors/laser a rising through 19.5: at scan 1000,")
    assert not recorder.error
    verify(tmp_path / "run")


def test_a_trigger_in_real_time_is_an_event_and_a_wrong_channel_too(ros: TurnExecutor, tmp_path: Path) -> None:
    _, source = make(ros, tmp_path / "run", trigger="sensors/laser b")
    spin_until(ros, source.ready)
    source.block(0)
    spin_until(ros, lambda: "trigger" in source.kinds)
    source.finish(1)
    spin_until(ros, lambda: source.status is not None and not source.status.recording)
    assert open_bag(tmp_path / "run").result["trigger"].endswith("never")
    with pytest.raises(BagError, match="allowed: 'TOPIC SIGNAL'"):
        RecorderNode(parameter_overrides=[Parameter("bag", value=str(tmp_path / "x")), Parameter("trigger", value="x")])
    assert not (tmp_path / "x").exists()


def test_a_bag_is_split_while_it_is_recorded(ros: TurnExecutor, tmp_path: Path) -> None:
    _, source = make(ros, tmp_path / "run", lockstep=True, max_bag_duration=0.5)
    spin_until(ros, source.ready)
    for number in range(30):
        source.block(number)
        ros.spin_once(timeout_sec=0.0)
    source.finish(30)
    spin_until(ros, source.closed)
    assert sorted(path.name for path in (tmp_path / "run").glob("*.mcap")) == ["run_0.mcap", "run_1.mcap", "run_2.mcap"]
    found = verify(tmp_path / "run")
    assert found.by_topic["/sensors/laser"] == 30
    assert not found.lost
    with AnyReader([tmp_path / "run"], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        assert sum(1 for _ in reader.messages()) == found.messages
