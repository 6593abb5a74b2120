# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The launch files, run with `ros2 launch` where it is installed: they start the commands and end as those do."""

import importlib.util
import os
import re
import select
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import IO

import pytest
import yaml
from ament_index_python.packages import get_package_prefix
from graph_runs import scene_file, without_domain

from atpid_control.runs.read import open_bag
from atpid_control.runs.verify import verify
from atpid_control.stand.domain import own_domain
from atpid_control.stand.processes import START_NODE

ROOT = Path(__file__).resolve().parent.parent
HEIGHT_MAP = ROOT / "atpid_control/config/maps/standard.npz"
SCENE = ROOT / "scenes/stand_realtime.yaml"
EXECUTABLES = {
    "atpid_driver": ("motor_node", "labjack_node", "ni_node"),
    "atpid_control": (
        "atpid", "identifier_node", "live_node", "selector_node", "recorder_node", "replay_node", "supervisor_node",
    ),
    "atpid_sim": ("plant_node",),
}  # fmt: skip

needs_launch = pytest.mark.skipif(
    shutil.which("ros2") is None or importlib.util.find_spec("launch_ros") is None,
    reason="no `ros2 launch` here: the launch files are not run",
)


class Launch:
    """A running `ros2 launch`, in a session of its own as in a terminal."""

    def __init__(self, name: str, arguments: dict[str, object], folder: Path) -> None:
        given = [f"{argument}:={value}" for argument, value in arguments.items()]
        # the bench takes a domain of its own, where none is named
        environment = os.environ if name == "stand" else without_domain()
        self.process = subprocess.Popen(
            ["ros2", "launch", "atpid_control", f"{name}.launch.py", *given],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            cwd=folder, env={**environment, "ROS_LOG_DIR": str(folder / "log")}, start_new_session=True,
        )  # fmt: skip
        self.lines: list[str] = []

    @property
    def output(self) -> IO[str]:
        assert self.process.stdout is not None
        return self.process.stdout

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Read up to and with the line that has `pattern`; fail where the launch ends without one."""
        for line in self.output:
            self.lines.append(line.rstrip("\n"))
            if match := re.search(pattern, line):
                return match
        pytest.fail(f"no line with {pattern!r} in:\n" + "\n".join(self.lines))

    def interrupt(self) -> None:
        """Send what Ctrl-C in a terminal sends: SIGINT to the launch and to the command."""
        os.killpg(self.process.pid, signal.SIGINT)

    def end(self) -> int:
        self.lines += self.output.read().splitlines()
        return self.process.wait()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)


@contextmanager
def launched(name: str, folder: Path, **arguments: object) -> Iterator[Launch]:
    with own_domain() if name == "stand" else nullcontext():
        launch = Launch(name, arguments, folder)
        try:
            yield launch
        finally:
            with suppress(ProcessLookupError):
                os.killpg(launch.process.pid, signal.SIGKILL)
            launch.process.wait()
            launch.output.close()


def children(process: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def ended(process: int) -> None:
    """Wait until a process, which need not be one of ours, has ended."""
    with suppress(ProcessLookupError):
        handle = os.pidfd_open(process)
        select.select([handle], [], [])
        os.close(handle)


@pytest.fixture
def simulated(tmp_path: Path) -> dict[str, Path]:
    """Parameter files with which the stand runs without its devices."""
    acquisition = {
        "backend": "simulated", "rate": 1000.0, "channels": ["support_displacement", "beam_displacement"],
        "terminals": ["a", "b"], "calibrations": ["laser_support.yaml", "laser_beam.yaml"], "frequency": 5.47,
        "expect_recorder": True,
    }  # fmt: skip
    motor = {"backend": "simulated", "lowest": 0.017, "highest": 1.0, "speed": 0.3, "initial_height": 0.017}
    files = {}
    for name, values in (("labjack", acquisition), ("motor", motor)):
        files[f"{name}_config"] = tmp_path / f"{name}.yaml"
        files[f"{name}_config"].write_text(yaml.safe_dump({f"/**/{name}_node": {"ros__parameters": values}}))
    return files


@pytest.mark.parametrize(
    ("package", "node"), [(package, node) for package, nodes in EXECUTABLES.items() for node in nodes]
)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_before_python_starts_ends_it_quietly(package: str, node: str, number: int) -> None:
    """They are started with both signals blocked; each has to unblock them. The first may come at once."""
    place = Path("bin") if node == "atpid" else Path("lib") / package
    executable = Path(get_package_prefix(package)) / place / node
    at_once = ["sh", "-c", f'kill -{int(number)} $$; exec "$0"', str(executable)]
    done = subprocess.run([*START_NODE, *at_once], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_ctrl_c_given_often_while_a_stand_starts_ends_it_quietly(simulated: dict[str, Path], tmp_path: Path) -> None:
    """From the terminal and passed on by `ros2 launch`."""
    options = [f"--{name.replace('_', '-')}={file}" for name, file in simulated.items()]
    command = ["atpid", "stand", str(SCENE), f"--map={HEIGHT_MAP}", *options]
    with own_domain(), subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline()  # a warning
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.01)
        assert (process.returncode, process.stderr.read()) == (0, "")


@needs_launch
@pytest.mark.parametrize(
    ("name", "given", "status", "line"),
    [
        ("bench", {"mpa": "a.npz"}, 1, r"bench\.launch\.py: .*\bmpa; .*\bmap\?"),
        ("stand", {"labjack_config": "nothere.yaml"}, 2, "error: .*nothere.yaml: "),
        ("replay", {"bag": "nothere"}, 2, "error: .*nothere: "),
    ],
)
def test_a_wrong_argument_is_refused_before_a_node_starts(
    name: str, given: dict[str, object], status: int, line: str, tmp_path: Path
) -> None:
    scene = {} if name == "replay" else {"scene": SCENE}
    with launched(name, tmp_path, **{**scene, **given}) as launch:
        assert launch.end() == status, launch.text
        assert len([item for item in launch.lines if re.search(line, item)]) == 1, launch.text
        assert "Traceback" not in launch.text
        assert "_node]" not in launch.text


@needs_launch
def test_the_bench_ends_with_its_run(tmp_path: Path) -> None:
    """With the shipped map, which none has named."""
    folder = tmp_path / 'it\'s a "folder"'
    folder.mkdir()
    scene_file(SCENE, folder, duration=3.0, steady_window=(2.0, 3.0)).rename(folder / "a scene.yaml")
    with launched("bench", folder, scene="a scene.yaml", out="a 'run'") as launch:
        assert launch.end() == 0, launch.text
        assert "died" not in launch.text
    assert verify(folder / "a 'run'/bag").messages
    assert (folder / "a 'run'/report.html").exists()
    assert open_bag(folder / "a 'run'/bag").files["standard.npz"] == HEIGHT_MAP.read_bytes()


@needs_launch
@pytest.mark.parametrize("line", ["supervisor_node.: ready", "no abort level"], ids=["while it runs", "while it loads"])
def test_the_stand_runs_until_ctrl_c(line: str, simulated: dict[str, Path], tmp_path: Path) -> None:
    """Twice, as a person does; the source of samples is supervised."""
    with launched("stand", tmp_path, scene=SCENE, bag="run", map=HEIGHT_MAP, **simulated) as launch:
        launch.wait_for(line)
        launch.interrupt()
        if "ready" in line:
            launch.wait_for("user interrupted with ctrl-c")
            launch.interrupt()
        assert launch.end() == 0, launch.text
        assert "Traceback" not in launch.text
    if "ready" in line:
        assert re.search("answer.* of .*labjack_node", launch.text)
        assert verify(tmp_path / "run").messages


@needs_launch
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_node_outlives_its_launch(number: int, simulated: dict[str, Path], tmp_path: Path) -> None:
    with launched("stand", tmp_path, scene=SCENE, bag="run", map=HEIGHT_MAP, **simulated) as launch:
        launch.wait_for(r"recording \d+ topics")
        (command,) = children(launch.process.pid)
        nodes = children(command)
        assert len(nodes) == 6
        os.kill(launch.process.pid, number)
        for process in (*nodes, command):
            ended(process)
        assert launch.end() != 0, launch.text
    verify(tmp_path / "run")
