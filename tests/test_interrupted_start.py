# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every node takes SIGINT at any moment of its start: status 0, nothing printed, gone.

Nodes that run, with SIGTERM too: test_every_executable_starts_and_ends in tests/test_installation.py.
"""

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from atpid_control.stand.domain import own_domain
from atpid_control.stand.processes import START_NODE

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
CONTROL, DRIVER = ROOT / "atpid_control" / "config", ROOT / "atpid_driver" / "config"
SCENE, MAP = ROOT / "scenes" / "stand_realtime.yaml", CONTROL / "maps" / "standard.npz"
#: Arguments with which each node runs until it is stopped.
NODES: dict[str, list[Path | str]] = {
    "atpid_sim/plant_node": [f"scene:={SCENE}"],
    "atpid_control/foxglove_node": ["port:=0"],
    "atpid_control/identifier_node": [CONTROL / "identifier.yaml"],
    "atpid_control/selector_node": [CONTROL / "selector.yaml", f"scene:={SCENE}", f"map:={MAP}"],
    "atpid_control/supervisor_node": [CONTROL / "supervisor.yaml"],
    "atpid_control/recorder_node": ["bag:={folder}/bag"],
    "atpid_control/replay_node": [f"bag:={ROOT / 'bags' / 'thesis_4_3_short'}"],
    "atpid_driver/motor_node": [DRIVER / "motor.yaml"],
    "atpid_driver/labjack_node": [DRIVER / "labjack.yaml", "backend:=simulated"],
    "atpid_driver/ni_node": [DRIVER / "ni.yaml", "backend:=simulated"],
    "atpid_driver/acquisition_node": [
        "backend:=simulated", "rate:=1000.0", "channels:=[support_displacement]", "terminals:=[x]",
        "calibrations:=[laser_support.yaml]",
    ],
    "atpid_driver/feed_node": ["feed:={folder}/feed"],
}  # fmt: skip
SIGTERM_BIT = 1 << (signal.SIGTERM - 1)


def command_of(name: str, folder: Path) -> list[str]:
    """Return the command that starts a node, as the bench does."""
    package, executable = name.split("/")
    words = []
    for argument in NODES[name]:
        words += (
            ["--params-file", str(argument)] if isinstance(argument, Path) else ["-p", argument.format(folder=folder)]
        )
    return [*START_NODE, f"{get_package_prefix(package)}/lib/{package}/{executable}", "--ros-args", *words]


def handles_signals(process: subprocess.Popen[str]) -> bool:
    """Whether the process has a handler for SIGTERM: the executable's own code runs."""
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    caught = next(line for line in lines if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) & SIGTERM_BIT)


def loads_ros(process: subprocess.Popen[str]) -> bool:
    """Whether the process has loaded rclpy's library: it loads its modules, or makes its node."""
    return "_rclpy_pybind11" in Path(f"/proc/{process.pid}/maps").read_text()


def interrupted(
    name: str, folder: Path, moment: Callable[[subprocess.Popen[str]], bool], *numbers: int
) -> tuple[int, str]:
    """Start the node, send the signals when `moment` has come; return its exit status and what it printed."""
    process = subprocess.Popen(command_of(name, folder), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        deadline = time.monotonic() + 100.0
        while not moment(process):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
        for number in numbers:
            process.send_signal(number)
        printed, _ = process.communicate(timeout=100.0)
    finally:
        process.kill()
        process.wait()
    return process.returncode, printed


@pytest.mark.parametrize("name", NODES)
def test_an_interrupted_start_ends_quietly(name: str, tmp_path: Path) -> None:
    """While its modules load, which are each node's own."""
    with own_domain():
        assert interrupted(name, tmp_path, loads_ros, signal.SIGINT, signal.SIGINT) == (0, "")


@pytest.mark.parametrize("name", [*NODES][::4])  # all begin with the same lines
def test_a_start_interrupted_at_once_ends_quietly(name: str, tmp_path: Path) -> None:
    with own_domain():
        assert interrupted(name, tmp_path, handles_signals, signal.SIGINT, signal.SIGINT) == (0, "")


@pytest.mark.parametrize("name", [*NODES][::4])  # all begin with the same lines
def test_a_parameter_file_that_is_missing_is_one_line_and_status_2(name: str, tmp_path: Path) -> None:
    package, executable = name.split("/")
    command = [f"{get_package_prefix(package)}/lib/{package}/{executable}", "--ros-args", "--params-file", "none.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert "none.yaml" in line
