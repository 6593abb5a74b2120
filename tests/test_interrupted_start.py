# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every node takes SIGINT while it loads: status 0, nothing printed, gone. Other moments: test_interrupt.py."""

import signal
import subprocess
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


def executable(name: str) -> str:
    package, file = name.split("/")
    return f"{get_package_prefix(package)}/lib/{package}/{file}"


def loads_ros(pid: int) -> bool:
    """Whether the process has loaded rclpy's library: it loads its modules, or makes its node."""
    return "_rclpy_pybind11" in Path(f"/proc/{pid}/maps").read_text()


def interrupted(name: str, folder: Path) -> tuple[int, str]:
    """Start the node as the bench does, send SIGINT twice while it loads; return its status and what it printed."""
    words = []
    for argument in NODES[name]:
        is_file = isinstance(argument, Path)
        words += ["--params-file" if is_file else "-p", str(argument).format(folder=folder)]
    command = [*START_NODE, executable(name), "--ros-args", *words]
    with own_domain(), subprocess.Popen(command, stdout=PIPE, stderr=STDOUT, text=True) as process:
        try:
            wait_until(lambda: loads_ros(process.pid), process)
            process.send_signal(signal.SIGINT)
            process.send_signal(signal.SIGINT)
            printed, _ = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    return process.returncode, printed


@pytest.mark.parametrize("name", NODES)
def test_an_interrupted_start_ends_quietly(name: str, tmp_path: Path) -> None:
    """While its modules load, which are each node's own."""
    assert interrupted(name, tmp_path) == (0, "")


@pytest.mark.parametrize("name", [*NODES][::4])
def test_a_parameter_file_that_is_missing_is_one_line_and_status_2(name: str, tmp_path: Path) -> None:
    command = [executable(name), "--ros-args", "--params-file", "none.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert "none.yaml" in line
