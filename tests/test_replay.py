# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A replayed bag gives the estimates and commands that are recorded in it."""

import math
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml
from atpid_interfaces.msg import CeilingCommand, Event, Excitation, SampleBlock
from graph_runs import in_lockstep, scene_file
from node_graph import NodeGraph
from rclpy.context import Context
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES, nanoseconds_of, time_of
from atpid_control.identification.linear import LEAST_PIVOT
from atpid_control.nodes.replay_node import ReplayNode
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.playback import ABSOLUTE, RELATIVE
from atpid_control.runs.read import Bag, open_bag
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter
from atpid_control.stand.nodes.composition import node_class
from atpid_control.stand.parameters import parameters_in
from atpid_control.stand.replay_files import write_replay_files

ROOT = Path(__file__).resolve().parent.parent
# recorded on another machine
SHIPPED = sorted(path.parent for path in ROOT.glob("bags/**/metadata.yaml"))
DURATION = 3.0
SHORT = {
    "duration": DURATION, "steady_window": [2.0, 3.0], "sensors": {"laser": {"noise": 20.0e-6}}, "seed": 3,
    "amplitude": [[0.0, 0.0], [0.2, 0.01], [1.3, 0.01], [1.5, 0.02]],
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of the whole graph."""
    folder = tmp_path_factory.mktemp("recorded")
    return in_lockstep(scene_file(scenes / "thesis_4_3.yaml", folder, **SHORT), folder / "run").path


@pytest.fixture
def graph() -> Iterator[NodeGraph]:
    with closing(NodeGraph()) as made:
        yield made


def replay(graph: NodeGraph, bag: Path, folder: Path, rate: float, height_map: Path | None = None) -> Bag:
    """Replay `bag` into a fresh identifier and selector; return what is recorded of it. height_map: not kept in it."""
    files = write_replay_files(bag, folder, rate=rate, record=folder / "replayed", height_map=height_map)
    document = yaml.safe_load(files.parameters.read_text(encoding="utf-8"))
    for name in ("identifier_node", "selector_node", "recorder_node", "replay_node"):
        player = graph.make(node_class("atpid_control", name), parameters_in(document, name))
    graph.until(player.done.done)
    assert player.done.result() == 0
    return open_bag(folder / "replayed")


def fields(message: Any) -> dict[str, Any]:
    """All fields, NaN as a word so that it equals itself."""
    found: dict[str, Any] = {}
    for name, value in vars(message).items():
        if hasattr(value, "__dataclass_fields__"):
            found[name] = fields(value)
        else:
            found[name] = "nan" if isinstance(value, float) and math.isnan(value) else value
    return found


def answers(bag: Bag, topic: str) -> list[dict[str, Any]]:
    return [fields(message) for _, message in bag.messages(topic)]


def close(one: Any, other: Any) -> bool:
    """Equal but for what another processor rounds otherwise, also where a fit is as near to singular as is accepted."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(close(one[key], other[key]) for key in one)
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return bool(one == other)


@pytest.mark.parametrize("rate", [0.0, 8.0])
def test_a_replay_gives_estimates_and_commands(graph: NodeGraph, recorded: Path, tmp_path: Path, rate: float) -> None:
    heard = graph.collect(Clock, "/clock", 100)
    began = time.monotonic()
    height_map = ROOT / "atpid_control/config/maps/standard.npz"
    before, after = open_bag(recorded), replay(graph, recorded, tmp_path, rate, height_map)
    assert len(answers(before, "/excitation")) == 20.0 * DURATION
    assert len(answers(before, "/sensors/laser")) == len(answers(after, "/sensors/laser"))
    for topic in ("/excitation", "/ceiling/command"):
        assert answers(before, topic) == answers(after, topic)
    heights = {message.height for _, message in after.messages("/ceiling/command")}
    assert len({height for height in heights if not math.isnan(height)}) >= 2, "the ceiling never moved in this run"
    clocks = [nanoseconds_of(message.clock) for message in heard]
    assert clocks == sorted(clocks)
    assert clocks[-1] >= (DURATION - 0.05) * 1e9
    if rate:
        assert time.monotonic() - began >= 0.9 * DURATION / rate


def test_the_tolerance_of_a_replay_is_that_of_the_arithmetic() -> None:
    assert sys.float_info.epsilon / LEAST_PIVOT == RELATIVE


@pytest.mark.parametrize("bag", SHIPPED, ids=lambda path: path.name)
def test_the_bags_that_come_with_the_project(graph: NodeGraph, bag: Path, tmp_path: Path) -> None:
    verify(bag)
    before, after = open_bag(bag), replay(graph, bag, tmp_path, 0.0)
    for topic in ("/excitation", "/ceiling/command"):
        given, found = answers(before, topic), answers(after, topic)
        assert len(given) == len(found) > 0
        for answer in (*given, *found):  # these bags have the device here, where a frame is today
            del answer["header"]["frame_id"]
        assert all(close(one, other) for one, other in zip(given, found, strict=True))


class Loop(Node):
    """Stands in for identifier and selector: answers each block as they do."""

    def __init__(self, context: Context) -> None:
        super().__init__("loop", context=context)
        self.blocks: list[SampleBlock] = []
        self.clocks: list[int] = []
        self.finished = ""
        self._estimates = self.create_publisher(Excitation, "excitation", STATES)
        self._commands = self.create_publisher(CeilingCommand, "ceiling/command", STATES)
        self.create_subscription(SampleBlock, "sensors/laser", self._on_block, BLOCKS)
        self.create_subscription(Event, "events", self._on_event, EVENTS)
        self.create_subscription(Clock, "/clock", lambda message: self.clocks.append(nanoseconds_of(message.clock)), 10)

    def _on_block(self, block: SampleBlock) -> None:
        command = CeilingCommand(header=block.header, handshake=block.handshake)
        if not block.handshake:
            assert self.clocks, "/clock comes before the first data"
            self.blocks.append(block)
            scans = len(block.data) // len(block.channels)
            last = nanoseconds_of(block.header.stamp) + round((scans - 1) / block.rate * 1e9)
            command.header.stamp = time_of(last)
        self._commands.publish(command)

    def _on_event(self, event: Event) -> None:
        self.finished = event.text if event.kind == "finished" else self.finished


def player(graph: NodeGraph, bag: Path) -> tuple[ReplayNode, Loop]:
    return graph.make(ReplayNode, {"bag": str(bag), "rate": 0.0}), graph.add(Loop(graph.context))


def test_only_sensors_are_played_unless_asked(graph: NodeGraph, recorded: Path) -> None:
    node, loop = player(graph, recorded)
    assert set(node.playback.topics) == {"/sensors/laser"}
    graph.until(node.done.done)
    graph.until(lambda: loop.finished != "")
    assert [block.first_index for block in loop.blocks] == list(range(0, round(1000 * DURATION), 50))


def test_a_replay_beside_a_live_source_is_refused(graph: NodeGraph, recorded: Path) -> None:
    graph.peer.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
    node, loop = player(graph, recorded)
    graph.until(node.done.done)
    assert node.done.result() == 2
    assert not loop.blocks


def bad_bags(folder: Path) -> dict[Path, str]:
    """Return folders and files that are no bag to replay, and a word of what is said about each."""
    for name in ("empty", "text"):
        (folder / name).mkdir()
    (folder / "text" / "text_0.mcap").write_text("no bag at all\n")
    (folder / "text" / "metadata.yaml").write_text("a: 1\n")
    (folder / "note.txt").write_text("no bag at all\n")
    never_closed = BagWriter(folder / "open", new_run())
    never_closed.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    never_closed.sync()
    without_sensors = BagWriter(folder / "silent", new_run())
    without_sensors.add_topic("/events", "atpid_interfaces/msg/Event")
    without_sensors.close()
    words = {"note.txt": "bag", "text": "bag", "empty": r"\.mcap", "missing": "such", "open": r"metadata\.yaml",
             "silent": "topic"}  # fmt: skip
    return {folder / name: word for name, word in words.items()}


def test_a_bad_bag_is_one_line(graph: NodeGraph, tmp_path: Path) -> None:
    for bag, word in bad_bags(tmp_path).items():
        with pytest.raises(BagError, match=rf"^[^\n]*{bag}[^\n]*{word}[^\n]*$"):
            graph.make(ReplayNode, {"bag": str(bag)})
    with pytest.raises(BagError, match="parameter bag"):
        graph.make(ReplayNode, {})
