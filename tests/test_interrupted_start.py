# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every node takes SIGINT at any moment of its start: status 0, nothing printed, gone.

Nodes that run, with SIGTERM too: test_every_executable_starts_and_ends in tests/test_installation.py.
"""

import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE, STDOUT

import pytest
from ament_index_python.packages import get_package_prefix
from graph_runs import wait_until

from atpid_common.testing import PATIENCE
from atpid_control.stand.domain import own_domain
from atpid_control.stand.processes import START_NODE

ROOT = Path(__file__).resolve().parent.parent
CONTROL, DRIVER = ROOT / "atpid_control" / "config", ROOT / "atpid_driver" / "config"
SCENE, MAP = ROOT / "scenes" / "stand_realtime.yaml", CONTROL / "maps" / "standard.npz"
#: Arguments with which each node runs until it is stopped.
NODES: dict[str, list[Path | str]] = {
    "atpid_sim/plant_node": [f"scene:={SCENE}"],
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
    "atpid_lab/foxglove_node": ["port:=0"],
}  # fmt: skip
SIGTERM_BIT = 1 << (signal.SIGTERM - 1)


def executable(name: str) -> str:
    package, file = name.split("/")
    return f"{get_package_prefix(package)}/lib/{package}/{file}"


def handles_signals(pid: int) -> bool:
    """Whether the process has a handler for SIGTERM: the executable's own code runs."""
    (caught,) = re.findall(r"SigCgt:\s*(\w+)", Path(f"/proc/{pid}/status").read_text())
    return bool(int(caught, 16) & SIGTERM_BIT)


def loads_ros(pid: int) -> bool:
    """Whether the process has loaded rclpy's library: it loads its modules, or makes its node."""
    return "_rclpy_pybind11" in Path(f"/proc/{pid}/maps").read_text()


def interrupted(name: str, folder: Path, moment: Callable[[int], bool]) -> tuple[int, str]:
    """Start the node as the bench does, send SIGINT twice at `moment`; return its status and what it printed."""
    words = []
    for argument in NODES[name]:
        is_file = isinstance(argument, Path)
        words += ["--params-file" if is_file else "-p", str(argument).format(folder=folder)]
    command = [*START_NODE, executable(name), "--ros-args", *words]
    with own_domain(), subprocess.Popen(command, stdout=PIPE, stderr=STDOUT, text=True) as process:
        try:
            wait_until(lambda: moment(process.pid), process)
            process.send_signal(signal.SIGINT)
            process.send_signal(signal.SIGINT)
            printed, _ = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    return process.returncode, printed


@pytest.mark.parametrize("name", NODES)
def test_an_interrupted_start_ends_quietly(name: str, tmp_path: Path) -> None:
    """While its modules load, which are each node's own."""
    assert interrupted(name, tmp_path, loads_ros) == (0, "")


@pytest.mark.parametrize("name", [*NODES][::4])  # all begin with the same lines
def test_a_start_interrupted_at_once_ends_quietly(name: str, tmp_path: Path) -> None:
    assert interrupted(name, tmp_path, handles_signals) == (0, "")


@pytest.mark.parametrize("name", [*NODES][::4])
def test_a_parameter_file_that_is_missing_is_one_line_and_status_2(name: str, tmp_path: Path) -> None:
    command = [executable(name), "--ros-args", "--params-file", "none.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert "none.yaml" in line
