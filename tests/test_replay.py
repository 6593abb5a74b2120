# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A replayed bag gives the estimates and commands that are recorded in it."""

import math
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import yaml
from ament_index_python.packages import get_package_prefix
from atpid_interfaces.msg import CeilingCommand, Event, Excitation, SampleBlock
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from test_recording_node import ros as ros
from test_recording_node import spin_until

from atpid_common.nodes.messages import BLOCKS, EVENTS, STATES
from atpid_common.nodes.turns import TurnExecutor
from atpid_control.identification.linear import LEAST_PIVOT
from atpid_control.nodes.replay_node import ReplayNode
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.playback import ABSOLUTE, RELATIVE
from atpid_control.runs.read import Bag, open_bag
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter
from atpid_control.stand.nodes.composition import node_class, run_lockstep
from atpid_control.stand.parameters import parameters_in
from atpid_control.stand.parts import PARTS, parameters_for

ROOT = Path(__file__).resolve().parent.parent
HEIGHT_MAP = ROOT / "atpid_control/config/maps/standard.npz"
# recorded on another machine
SHIPPED = sorted(path.parent for path in ROOT.glob("bags/**/metadata.yaml"))
SHORT = """
beam:       {mass: 0.3258, stiffness: 427.6, damping: 0.56}
grain:      {mass_fraction: 0.1, radius: 0.0085}
contact:    {law: tsuji, young_modulus: 2.1e8, poisson_ratio: 0.2, damping_ratio: 1.0}
excitation: {amplitude: [[0.0, 0.0], [0.2, 0.01], [2.0, 0.01], [2.2, 0.02]], frequency: resonance}
ceiling:    {closed: 0.017, range: [0.017, 1.0], speed: 0.3, controller: lookup}
gravity:    9.81
duration:   4.0
steady_window: [3.0, 4.0]
tolerance:  1.0e-4
sensors:    {laser: {noise: 20.0e-6}}
seed:       3
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run of the whole graph."""
    folder = tmp_path_factory.mktemp("recorded")
    scene = folder / "short.yaml"
    scene.write_text(SHORT)
    lockstep(scene, folder / "run")
    return folder / "run"


def lockstep(scene_file: Path, bag: Path) -> None:
    from atpid_sim.scene import load_scene

    parameters = parameters_for(load_scene(scene_file), scene_file, HEIGHT_MAP, bag, lockstep=True)
    run_lockstep([(part.package, part.name) for part in PARTS], parameters, lambda _: None)


def replay(executor: TurnExecutor, bag: Path, scene: Path, out: Path, rate: float) -> ReplayNode:
    """Replay `bag` into a fresh identifier and selector, and record what they answer."""
    own = parameters_for_replay(bag, scene, out, rate)
    nodes = {}
    for package, name in (("atpid_control", name) for name in own):
        overrides = [Parameter(key, value=value) for key, value in own[name].items()]
        nodes[name] = node_class(package, name)(parameter_overrides=overrides)
        executor.add_node(nodes[name])
    player: ReplayNode = nodes["replay_node"]
    spin_until(executor, player.done.done)
    assert player.done.result() == 0
    return player


def parameters_for_replay(bag: Path, scene_file: Path, out: Path, rate: float) -> dict[str, dict[str, Any]]:
    from atpid_sim.scene import load_scene

    parameters = parameters_for(load_scene(scene_file), scene_file, HEIGHT_MAP, out, lockstep=True)
    chosen = {name: parameters[name] for name in ("identifier_node", "selector_node", "recorder_node")}
    kept = open_bag(bag).files
    document = yaml.safe_load(kept.get("parameters.yaml", b"{}"))
    for name in ("identifier_node", "selector_node"):
        # as it was started then; paths are this machine's own
        paths = {key: value for key, value in chosen[name].items() if key in ("scene", "map")}
        chosen[name] |= parameters_in(document, name) | paths
    for name, data in kept.items():
        if name.endswith(".npz"):
            (out.parent / name).write_bytes(data)
            chosen["selector_node"]["map"] = str(out.parent / name)
    topics = ["sensors/*", "ceiling/state"]
    return {**chosen, "replay_node": {"bag": str(bag), "rate": rate, "topics": topics, "expect_recorder": True}}


def scene_of(bag: Path, folder: Path) -> Path:
    text = open_bag(bag).scene_text
    assert text is not None
    (folder / "scene.yaml").write_text(text)
    return folder / "scene.yaml"


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


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.0, 8.0])
def test_a_replay_gives_the_recorded_estimates_and_commands(
    ros: TurnExecutor, recorded: Path, tmp_path: Path, rate: float
) -> None:
    replay(ros, recorded, scene_of(recorded, tmp_path), tmp_path / "replayed", rate)
    before, after = open_bag(recorded), open_bag(tmp_path / "replayed")
    assert len(answers(before, "/excitation")) == 80
    for topic in ("/sensors/laser", "/excitation", "/ceiling/command"):
        if topic == "/sensors/laser":
            assert len(answers(before, topic)) == len(answers(after, topic))
        else:
            assert answers(before, topic) == answers(after, topic)
    heights = {message.height for _, message in after.messages("/ceiling/command")}
    assert len({height for height in heights if not math.isnan(height)}) >= 2, "the ceiling never moved in this run"


def test_the_tolerance_of_a_replay_is_that_of_the_arithmetic() -> None:
    assert sys.float_info.epsilon / LEAST_PIVOT == RELATIVE


@pytest.mark.slow
@pytest.mark.parametrize("bag", SHIPPED, ids=lambda path: path.name)
def test_the_bags_that_come_with_the_project(ros: TurnExecutor, bag: Path, tmp_path: Path) -> None:
    verify(bag)
    replay(ros, bag, scene_of(bag, tmp_path), tmp_path / "replayed", 0.0)
    before, after = open_bag(bag), open_bag(tmp_path / "replayed")
    for topic in ("/excitation", "/ceiling/command"):
        given, found = answers(before, topic), answers(after, topic)
        assert len(given) == len(found) > 0
        for answer in (*given, *found):  # these bags have the device here, where a frame is today
            del answer["header"]["frame_id"]
        assert all(close(one, other) for one, other in zip(given, found, strict=True))


class Loop(Node):
    """Stands in for identifier and selector: answers each block as they do."""

    def __init__(self) -> None:
        super().__init__("loop")
        self.blocks: list[SampleBlock] = []
        self.clocks: list[int] = []
        self.finished = ""
        self.quiet = False
        self._estimates = self.create_publisher(Excitation, "excitation", STATES)
        self._commands = self.create_publisher(CeilingCommand, "ceiling/command", STATES)
        self.create_subscription(SampleBlock, "sensors/laser", self._on_block, BLOCKS)
        self.create_subscription(Event, "events", self._on_event, EVENTS)
        self.create_subscription(
            Clock, "/clock", lambda m: self.clocks.append(m.clock.sec * 10**9 + m.clock.nanosec), 10
        )

    def _on_block(self, block: SampleBlock) -> None:
        command = CeilingCommand(header=block.header, handshake=block.handshake)
        if not block.handshake:
            assert self.clocks, "/clock comes before the first data"
            self.blocks.append(block)
            scans = len(block.data) // len(block.channels)
            nanoseconds = (
                block.header.stamp.sec * 10**9 + block.header.stamp.nanosec + round((scans - 1) / block.rate * 1e9)
            )
            command.header.stamp.sec, command.header.stamp.nanosec = divmod(nanoseconds, 10**9)
        self._commands.publish(command)

    def _on_event(self, event: Event) -> None:
        self.finished = event.text if event.kind == "finished" else self.finished


def player(executor: TurnExecutor, bag: Path, **parameters: Any) -> tuple[ReplayNode, Loop]:
    overrides = [Parameter(name, value=value) for name, value in {"bag": str(bag), **parameters}.items()]
    nodes = ReplayNode(parameter_overrides=overrides), Loop()
    for node in nodes:
        executor.add_node(node)
    return nodes


def test_only_sensors_are_played_unless_asked(ros: TurnExecutor, recorded: Path) -> None:
    node, loop = player(ros, recorded, rate=0.0)
    assert set(node.playback.topics) == {"/sensors/laser"}
    spin_until(ros, node.done.done)
    spin_until(ros, lambda: loop.finished != "")
    assert [block.first_index for block in loop.blocks] == list(range(0, 4000, 50))
    assert "x real time" in loop.finished


@pytest.mark.slow
def test_a_paced_replay_follows_the_wall_clock_and_publishes_it(ros: TurnExecutor, recorded: Path) -> None:
    began = time.monotonic()
    node, loop = player(ros, recorded, rate=10.0)
    spin_until(ros, node.done.done)
    assert time.monotonic() - began >= 0.9 * 4.0 / 10.0
    assert loop.clocks == sorted(loop.clocks)
    assert loop.clocks[-1] >= 3_950_000_000
    assert len(loop.blocks) == 80


def test_a_replay_beside_a_live_source_is_refused(ros: TurnExecutor, recorded: Path) -> None:
    source = Node("stand")
    source.create_publisher(SampleBlock, "sensors/laser", BLOCKS)
    ros.add_node(source)
    node, loop = player(ros, recorded, rate=0.0)
    spin_until(ros, node.done.done)
    assert node.done.result() == 2
    assert not loop.blocks


def bad_bags(folder: Path) -> dict[str, tuple[Path, str]]:
    (folder / "empty").mkdir()
    (folder / "text").mkdir()
    (folder / "text" / "text_0.mcap").write_text("no bag at all\n")
    (folder / "text" / "metadata.yaml").write_text("a: 1\n")
    (folder / "note.txt").write_text("no bag at all\n")
    open_one = BagWriter(folder / "open", new_run())
    open_one.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    open_one.sync()
    closed = BagWriter(folder / "silent", new_run())
    closed.add_topic("/events", "atpid_interfaces/msg/Event")
    closed.close()
    return {
        "a file of text": (folder / "note.txt", "not a bag"),
        "text under a bag's name": (folder / "text", "not a bag"),
        "an empty folder": (folder / "empty", "no .mcap or .db3 file"),
        "a missing folder": (folder / "missing", "no such bag"),
        "a bag never closed": (folder / "open", "metadata.yaml is missing"),
        "a bag without sensors": (folder / "silent", "no topic fits"),
    }


def test_a_bad_bag_is_one_line(ros: TurnExecutor, tmp_path: Path) -> None:
    for bag, message in bad_bags(tmp_path).values():
        with pytest.raises(BagError, match=message) as caught:
            ReplayNode(parameter_overrides=[Parameter("bag", value=str(bag))])
        assert str(bag) in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(BagError, match="not given"):
        ReplayNode()


def test_a_bad_bag_ends_the_process_with_status_2(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("no bag at all\n")
    executable = Path(get_package_prefix("atpid_control")) / "lib/atpid_control/replay_node"
    command = [str(executable), "--ros-args", "-p", f"bag:={tmp_path / 'note.txt'}"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=100.0, check=False)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "not a bag" in ended.stderr


@pytest.mark.slow
def test_ctrl_c_ends_a_replay_quietly(ros: TurnExecutor, recorded: Path) -> None:
    loop = Loop()
    ros.add_node(loop)
    executable = Path(get_package_prefix("atpid_control")) / "lib/atpid_control/replay_node"
    with ExitStack() as stack:
        process = subprocess.Popen(
            [executable, "--ros-args", "-p", f"bag:={recorded}", "-p", "rate:=0.1"], stderr=subprocess.PIPE, text=True
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        spin_until(ros, lambda: len(loop.blocks) > 0 or process.poll() is not None)
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate(timeout=100.0)
    assert process.returncode == 0, printed
    assert "Traceback" not in printed
