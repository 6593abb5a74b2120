# SPDX-License-Identifier: Apache-2.0
"""The launch files, run with `ros2 launch` where it is installed.

It is not among the wheels; there these tests are left out, and only the names in the launch files are checked. The
checks of the arguments have tests that need no `launch`: atpid_control/test/test_launching.py.
"""

import ast
import importlib.util
import os
import re
import select
import shutil
import signal
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import entry_points
from pathlib import Path
from typing import IO, Any

import pytest
import yaml
from ament_index_python.packages import get_package_prefix
from graph_runs import scene_file

from atpid_control.bags import verify
from atpid_control.bags.playback import compare
from atpid_control.bags.read import open_bag
from atpid_control.cli import main
from atpid_control.launching.arguments import (
    BENCH,
    LIVE,
    OPTIONS,
    REPLAY,
    STAND,
    START,
    LaunchArgumentError,
    parameter_file,
)

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "atpid_control" / "launch"
ARGUMENTS = {"bench": BENCH, "stand": STAND, "replay": REPLAY}
HEIGHT_MAP = ROOT / "atpid_control/config/maps/standard.npz"
SCENE = ROOT / "scenes/stand_realtime.yaml"
BAG = ROOT / "bags/thesis_4_3_short"
BENCH_NODES = {"plant_node", "identifier_node", "selector_node", "motor_node", "recorder_node", "supervisor_node"}
STAND_NODES = BENCH_NODES - {"plant_node"} | {"labjack_node"}
NODES = [
    *(("atpid_driver", node) for node in ("motor_node", "labjack_node", "ni_node")),
    *(
        ("atpid_control", node)
        for node in ("identifier_node", "live_node", "selector_node", "recorder_node", "replay_node", "supervisor_node")
    ),
    ("atpid_sim", "plant_node"),
]

needs_launch = pytest.mark.skipif(
    shutil.which("ros2") is None or importlib.util.find_spec("launch_ros") is None,
    reason="no `ros2 launch` here: the launch files are not run",
)


class Launch:
    """A running `ros2 launch`, in a session of its own as in a terminal."""

    def __init__(self, name: str, arguments: dict[str, object], folder: Path) -> None:
        given = [f"{argument}:={value}" for argument, value in arguments.items()]
        self.process = subprocess.Popen(
            ["ros2", "launch", "atpid_control", f"{name}.launch.py", *given],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            cwd=folder, env={**os.environ, "ROS_LOG_DIR": str(folder / "log")}, start_new_session=True,
        )  # fmt: skip
        self.lines: list[str] = []
        self.pids: dict[str, int] = {}

    @property
    def output(self) -> IO[str]:
        assert self.process.stdout is not None
        return self.process.stdout

    def wait_for(self, pattern: str) -> None:
        """Read up to and with the line that has `pattern`; fail where the launch ends without one."""
        for line in self.output:
            self.lines.append(line.rstrip("\n"))
            if started := re.match(r"\[INFO\] \[(\w+)-\d+\]: process started with pid \[(\d+)\]", line):
                self.pids[started[1]] = int(started[2])
            if re.search(pattern, line):
                return
        pytest.fail(f"no line with {pattern!r} in:\n" + "\n".join(self.lines))

    def wait_for_nodes(self, count: int) -> None:
        """Read on until `count` nodes have been started."""
        while len(self.pids) < count:
            self.wait_for("process started")

    def interrupt(self) -> None:
        """Send what Ctrl-C in a terminal sends: SIGINT to the launch and to every node."""
        os.killpg(self.process.pid, signal.SIGINT)

    def end(self) -> int:
        """Read the rest; return the exit status."""
        self.lines += self.output.read().splitlines()
        return self.process.wait()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    @property
    def errors(self) -> list[str]:
        """The launch's own lines about errors, without what `launch` says of each process."""
        return [line.partition("traceback): ")[2] for line in self.lines if line.startswith("[ERROR] [launch]")]


@contextmanager
def launched(name: str, folder: Path, **arguments: object) -> Iterator[Launch]:
    launch = Launch(name, arguments, folder)
    try:
        yield launch
    finally:
        with suppress(ProcessLookupError):
            os.killpg(launch.process.pid, signal.SIGKILL)
        launch.process.wait()
        launch.output.close()


def ended(pids: Iterable[int]) -> None:
    """Wait until each process has ended."""
    for pid in pids:
        try:
            handle = os.pidfd_open(pid)
        except ProcessLookupError:
            continue
        select.select([handle], [], [])
        os.close(handle)


@pytest.fixture
def short_scene(tmp_path: Path, scenes: Path) -> Path:
    return scene_file(scenes / "stand_realtime.yaml", tmp_path, duration=3.0, steady_window=(2.0, 3.0))


@pytest.mark.parametrize("name", ARGUMENTS)
def test_what_a_launch_file_names_exists(name: str) -> None:
    """Nodes, parameter files and arguments: read from the file's text, so that it needs no `launch`."""
    calls = [item for item in ast.walk(ast.parse((FOLDER / f"{name}.launch.py").read_text())) if type(item) is ast.Call]
    names = ("GraphNode", "config", "text", "texts", "LaunchConfiguration")
    named: dict[str, set[tuple[Any, ...]]] = {function: set() for function in names}
    for call in calls:
        function = getattr(call.func, "id", "")
        if function in named:
            named[function].add(tuple(item.value for item in call.args if isinstance(item, ast.Constant)))
    installed = [(script.dist, script.name) for script in entry_points(group="console_scripts")]
    scripts = {(found.name.replace("-", "_"), script) for found, script in installed if found is not None}
    assert named["GraphNode"]
    assert named["GraphNode"] <= scripts
    assert all((ROOT / package / "config" / file).is_file() for package, file in named["config"])
    used = {word for words in named["text"] | named["texts"] | named["LaunchConfiguration"] for word in words}
    if name == "replay":
        used |= {"bag", *OPTIONS}
    if "live_page" in {getattr(call.func, "id", "") for call in calls}:
        used |= {argument.name for argument in LIVE}
    assert used == {argument.name for argument in ARGUMENTS[name]}


@pytest.mark.parametrize(("package", "node"), NODES)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_before_python_starts_ends_a_node_quietly(package: str, node: str, number: int) -> None:
    """The launch files start nodes with both signals blocked; each has to unblock them. The first may come at once."""
    executable = Path(get_package_prefix(package)) / "lib" / package / node
    at_once = ["sh", "-c", f'kill -{int(number)} $$; exec "$0"', str(executable)]
    done = subprocess.run([*START.split(), *at_once], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
def test_a_replay_gets_the_parameters_of_the_bag(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """What replay.launch.py does before its nodes start; it needs no `launch`."""
    file = parameter_file({"bag": str(BAG), "rate": "0.0", "record": str(tmp_path / "again"), "scene": "", "map": ""})
    document = yaml.safe_load(Path(file).read_text())
    kept = yaml.safe_load(open_bag(BAG).files["parameters.yaml"])["/selector_node"]["ros__parameters"]
    selector = document["/**/selector_node"]["ros__parameters"]
    assert {key: selector[key] for key in kept if key not in ("scene", "map")} == {
        key: value for key, value in kept.items() if key not in ("scene", "map")
    }
    assert document["/**/replay_node"]["ros__parameters"]["rate"] == 0.0
    with pytest.raises(LaunchArgumentError, match=r"replay.launch.py: .*nothere: no such bag"):
        parameter_file({"bag": "nothere"})


@needs_launch
@pytest.mark.parametrize("name", ARGUMENTS)
def test_the_arguments_are_shown(name: str) -> None:
    command = ["ros2", "launch", "atpid_control", f"{name}.launch.py", "--show-args"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert re.findall(r"^    '(.*)':$", shown, flags=re.MULTILINE) == [item.name for item in ARGUMENTS[name]]
    choices = [item.choices for item in ARGUMENTS[name] if item.choices]
    assert re.findall(r"Valid choices are: \[(.*)\]", shown) == [str(list(found))[1:-1] for found in choices]


@needs_launch
@pytest.mark.parametrize(
    ("name", "given", "line"),
    [
        ("stand", {"ni": "perhaps"}, "stand.launch.py: argument ni: given 'perhaps'; allowed: false or true"),
        ("stand", {"labjack_config": "nothere.yaml"}, "argument labjack_config: .*/nothere.yaml does not exist"),
        ("bench", {"scene": "nothere.yaml"}, "argument scene: .*/nothere.yaml does not exist; give a file"),
        ("bench", {"map": "nothere.npz"}, "argument map: .*/nothere.npz does not exist; give a file"),
        ("bench", {"bag": "."}, "argument bag: .* exists already, and a bag is never overwritten"),
        ("bench", {"mpa": "a.npz"}, r"bench.launch.py: unknown argument mpa; did you mean map\?"),
        ("bench", {"emulate_tty": "perhaps"}, "argument emulate_tty: given 'perhaps'"),
        ("replay", {"bag": BAG, "rate": "abc"}, "replay.launch.py: argument rate: given 'abc'; allowed: a number from"),
        ("replay", {"bag": "nothere"}, "argument bag: .*/nothere does not exist"),
    ],
)
def test_a_wrong_argument_is_refused_before_a_node_starts(
    name: str, given: dict[str, object], line: str, tmp_path: Path
) -> None:
    with launched(name, tmp_path, **{"scene": SCENE, **given}) as launch:
        assert launch.end() == 1, launch.text
        assert len(launch.errors) == 1
        assert re.search(line, launch.errors[0])
        assert "process started" not in launch.text
        assert "Traceback" not in launch.text


@needs_launch
def test_a_missing_scene_is_refused(tmp_path: Path) -> None:
    with launched("bench", tmp_path, sceen=SCENE) as launch:
        assert launch.end() == 1, launch.text
        assert "missing required argument 'scene'" in launch.text
        assert "given: [sceen]" in launch.text
        assert "process started" not in launch.text


@needs_launch
def test_another_launch_file_may_have_arguments_of_its_own(short_scene: Path, tmp_path: Path) -> None:
    """They stand on the same command line, and are none of ours."""
    outer = tmp_path / "outer.launch.py"
    outer.write_text(f"""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration

def generate_launch_description():
    given = {{"scene": LaunchConfiguration("scene"), "map": "nothere.npz"}}.items()
    return LaunchDescription([
        DeclareLaunchArgument("mine"),
        IncludeLaunchDescription({str(FOLDER / "bench.launch.py")!r}, launch_arguments=given),
    ])
""")
    done = subprocess.run(
        ["ros2", "launch", outer, f"scene:={short_scene}", "mine:=1"], capture_output=True, text=True, cwd=tmp_path,
        env={**os.environ, "ROS_LOG_DIR": str(tmp_path / "log")},
    )  # fmt: skip
    assert done.returncode == 1
    assert "argument map:" in done.stdout + done.stderr
    assert "unknown argument" not in done.stdout + done.stderr


@pytest.mark.slow
@needs_launch
def test_the_bench_ends_with_its_run(short_scene: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'it\'s a "folder"'
    folder.mkdir()
    short_scene.rename(folder / "a scene.yaml")
    with launched("bench", folder, scene="a scene.yaml", map=HEIGHT_MAP, bag="a 'bag'") as launch:
        assert launch.end() == 0, launch.text
        assert launch.errors == []
        assert "has died" not in launch.text
        assert launch.text.count("has finished cleanly") == len(BENCH_NODES)
    assert verify(folder / "a 'bag'").messages
    kept = open_bag(folder / "a 'bag'").files
    assert {"scene.yaml", "standard.npz", "motor.yaml"} <= set(kept)
    assert kept["standard.npz"] == HEIGHT_MAP.read_bytes()


@pytest.mark.slow
@needs_launch
def test_a_replay_is_recorded_in_the_folder_of_record(short_scene: Path, tmp_path: Path) -> None:
    """The folder's name is text: nothing of it is evaluated."""
    assert main(["bench", str(short_scene), "--out", str(tmp_path / "out")]) == 0  # its bag keeps parameters and map
    record = tmp_path / "it's' + str(print('evaluated')) + '$(env HOME) \"x\""
    with launched("replay", tmp_path, bag="out/bag", rate="0", record=record) as launch:
        assert launch.end() == 0, launch.text
        assert launch.errors == []
        assert "evaluated" not in launch.text.replace(str(record), "")
    assert verify(record).messages
    found = compare(open_bag(tmp_path / "out/bag"), open_bag(record))
    assert [one.agreeing for one in found] == [one.recorded for one in found] == [60, 60]


@pytest.mark.slow
@needs_launch
def test_a_bag_that_cannot_be_replayed_ends_the_launch_before_a_node_starts(tmp_path: Path) -> None:
    shutil.copytree(BAG, tmp_path / "bag")
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"torn")
    with launched("replay", tmp_path, bag="bag") as launch:
        assert launch.end() == 1, launch.text
        assert len(launch.errors) == 1
        assert "not a bag" in launch.errors[0]
        assert "process started" not in launch.text
        assert "Traceback" not in launch.text


@pytest.mark.slow
@needs_launch
@pytest.mark.parametrize(
    ("node", "number", "line"),
    [
        ("recorder_node", signal.SIGKILL, "recorder_node was ended by SIGKILL; the launch ends"),
        ("motor_node", signal.SIGKILL, "motor_node was ended by SIGKILL; the launch ends"),
        ("selector_node", signal.SIGTERM, r"selector_node ended by itself \(exit status 0\) before the run was over"),
    ],
)
def test_a_node_that_ends_before_its_time_ends_the_launch(node: str, number: int, line: str, tmp_path: Path) -> None:
    with launched("bench", tmp_path, scene=SCENE, map=HEIGHT_MAP, bag="run") as launch:
        launch.wait_for_nodes(len(BENCH_NODES))
        launch.wait_for(r"recording \d+ topics")
        os.kill(launch.pids[node], number)
        assert launch.end() == 1, launch.text
        assert len(launch.errors) == 1
        assert re.match(line, launch.errors[0])
        finished = [line for line in launch.lines if "has finished cleanly" in line]
        assert len(finished) == len(BENCH_NODES) - (number == signal.SIGKILL)
    if node != "recorder_node":
        assert "[recorder_node-" in finished[-1]
        verify(tmp_path / "run")


@pytest.mark.slow
@needs_launch
def test_a_node_that_refuses_ends_the_launch(tmp_path: Path) -> None:
    (tmp_path / "broken.npz").write_text("no map")
    with launched("bench", tmp_path, scene=SCENE, map="broken.npz") as launch:
        assert launch.end() == 1, launch.text
        assert launch.errors == ["selector_node ended with exit status 2; the launch ends"]
        assert "Traceback" not in launch.text


@pytest.mark.slow
@needs_launch
def test_ctrl_c_while_the_nodes_load_ends_them_quietly(tmp_path: Path) -> None:
    with launched("bench", tmp_path, scene=SCENE, map=HEIGHT_MAP, bag="run") as launch:
        launch.wait_for_nodes(len(BENCH_NODES))
        launch.interrupt()
        assert launch.end() == 0, launch.text
        assert launch.errors == []
        assert "Traceback" not in launch.text
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
@needs_launch
def test_ctrl_c_twice_ends_everything_in_order(tmp_path: Path) -> None:
    with launched("bench", tmp_path, scene=SCENE, map=HEIGHT_MAP, bag="run") as launch:
        launch.wait_for(r"recording \d+ topics")
        launch.interrupt()
        launch.wait_for("user interrupted with ctrl-c")
        launch.interrupt()
        assert launch.end() == 0, launch.text
        assert launch.errors == []
        assert "has died" not in launch.text
        assert "Traceback" not in launch.text
    verify(tmp_path / "run")


@pytest.mark.slow
@needs_launch
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_node_outlives_its_launch(number: int, tmp_path: Path) -> None:
    with launched("bench", tmp_path, scene=SCENE, map=HEIGHT_MAP, bag="run") as launch:
        launch.wait_for_nodes(len(BENCH_NODES))
        launch.wait_for(r"recording \d+ topics")
        os.kill(launch.process.pid, number)
        ended(launch.pids.values())
        assert launch.end() != 0, launch.text
    verify(tmp_path / "run")


@pytest.mark.slow
@needs_launch
@pytest.mark.parametrize(("ni", "nodes"), [("false", STAND_NODES), ("true", STAND_NODES | {"ni_node"})])
def test_the_stand_waits_for_its_devices_until_ctrl_c(ni: str, nodes: set[str], tmp_path: Path) -> None:
    with launched("stand", tmp_path, scene=SCENE, map=HEIGHT_MAP, ni=ni) as launch:
        launch.wait_for_nodes(len(nodes))
        assert set(launch.pids) == nodes
        launch.wait_for("labjack_node.*cannot configure")
        launch.interrupt()
        assert launch.end() == 0, launch.text
        assert launch.errors == []
        assert "Traceback" not in launch.text
