# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the documentation gives in place of `ros2`, which the wheels do not have: stand, nodes, topics, lifecycle."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest
import yaml
from graph_runs import wait_until

from atpid_control.commands.stand import NO_LEVELS
from atpid_control.runs.parts import find_parts
from atpid_control.runs.read import open_bag
from atpid_control.runs.verify import verify
from atpid_control.stand.domain import own_domain

pytestmark = pytest.mark.slow

WIRING = {
    "backend": "simulated",
    "rate": 1000.0,
    "channels": ["support_displacement", "beam_displacement"],
    "terminals": ["a", "b"],
    "calibrations": ["laser_support.yaml", "laser_beam.yaml"],
    "frequency": 5.47,
}


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain for the processes of one test."""
    with own_domain() as number:
        yield number


class Running:
    """A command that runs; what it prints on standard output and error is collected."""

    def __init__(self, *words: object, name: str = "reader", environment: dict[str, str] | None = None) -> None:
        self.lines: list[str] = []
        self.errors: list[str] = []
        given = {**(environment or os.environ), "PYTHONUNBUFFERED": "1"}
        self.process = subprocess.Popen(
            [*map(str, words)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=given,
        )  # fmt: skip
        pipes = ((self.process.stdout, self.lines), (self.process.stderr, self.errors))
        self._readers = [threading.Thread(target=self._read, args=pipe, name=name) for pipe in pipes]
        for reader in self._readers:
            reader.start()

    def _read(self, pipe: IO[str], lines: list[str]) -> None:
        with pipe:
            for line in pipe:
                lines.append(line.rstrip("\n"))  # noqa: PERF401  # each is seen by another thread at once

    def printed(self, words: str) -> bool:
        return any(words in line for line in [*self.lines, *self.errors])

    def wait_for(self, words: str) -> None:
        wait_until(lambda: self.printed(words) or self.process.poll() is not None)
        assert self.printed(words), (self.lines, self.errors)

    def end(self, number: int | None = None) -> int:
        """Send a signal, or none; return the exit status."""
        if number is not None:
            self.process.send_signal(number)
        status = self.process.wait(200.0)
        for reader in self._readers:
            reader.join()
        return status


Start = Callable[..., Running]


@pytest.fixture
def start(domain: int) -> Iterator[Start]:
    """Start commands, and stop what is left of them."""
    running: list[Running] = []

    def begin(*words: object) -> Running:
        running.append(Running(*words))
        return running[-1]

    yield begin
    for command in running:
        command.end(signal.SIGTERM if command.process.poll() is None else None)


def parameter_file(path: Path, node: str, **values: object) -> Path:
    path.write_text(yaml.safe_dump({f"/**/{node}": {"ros__parameters": values}}))
    return path


@pytest.mark.timeout(300)
def test_the_stand_runs_until_ctrl_c_and_its_bag_keeps_all_parameters(
    start: Start, root: Path, scenes: Path, tmp_path: Path
) -> None:
    labjack = parameter_file(tmp_path / "labjack.yaml", "labjack_node", **WIRING, expect_recorder=True)
    limits = {"lowest": 0.017, "highest": 1.0, "speed": 0.3, "initial_height": 0.017}
    motor = parameter_file(tmp_path / "motor.yaml", "motor_node", backend="simulated", **limits)
    levels = parameter_file(tmp_path / "levels.yaml", "supervisor_node", beam_displacement_abort=0.5)
    stand = start(
        "atpid", "stand", scenes / "stand_realtime.yaml", "--bag", tmp_path / "bag", "--params-file", levels,
        "--labjack-config", labjack, "--motor-config", motor, "--namespace", "lab1",
    )  # fmt: skip
    stand.wait_for("simulated:1 streams 2 channels at 1000 Hz")
    assert not stand.printed(NO_LEVELS)
    wait_until(lambda: find_parts(tmp_path / "bag")[0].stat().st_size > 150_000)  # more than it begins with
    assert stand.end(signal.SIGINT) == 0, stand.errors
    assert not stand.printed("Traceback")
    assert verify(tmp_path / "bag").by_topic["/lab1/sensors/laser"] > 0
    bag = open_bag(tmp_path / "bag")
    given = yaml.safe_load(bag.files["parameters.yaml"])["/**/supervisor_node"]["ros__parameters"]
    assert given["beam_displacement_abort"] == 0.5
    assert given["nodes"][:2] == ["motor_node", "labjack_node"]
    assert bag.files["standard.npz"] == (root / "atpid_control/config/maps/standard.npz").read_bytes()
    nodes = ("labjack_node", "motor_node", "identifier_node", "selector_node")
    assert {f"{node}.yaml" for node in nodes} <= set(bag.files)
    document = yaml.safe_load(bag.files["labjack_node.yaml"])
    assert document["/**/labjack_node"]["ros__parameters"]["frequency"] == 5.47
    assert "started" in [event.kind for _, event in bag.messages("/lab1/events")]


@pytest.mark.timeout(300)
def test_a_node_of_the_stand_that_ends_ends_the_stand(start: Start, scenes: Path, tmp_path: Path) -> None:
    labjack = parameter_file(tmp_path / "labjack.yaml", "labjack_node", **(WIRING | {"calibrations": ["none.yaml"]}))
    stand = start("atpid", "stand", scenes / "stand_realtime.yaml", "--bag", tmp_path / "bag",
                  "--labjack-config", labjack)  # fmt: skip
    assert stand.end() == 2
    assert stand.errors[-1].startswith("error: labjack_node ended with status 2")
    assert stand.errors[0] == NO_LEVELS


def test_a_bag_that_exists_is_refused_before_a_node_starts(start: Start, scenes: Path, tmp_path: Path) -> None:
    stand = start("atpid", "stand", scenes / "stand_realtime.yaml", "--bag", tmp_path)
    assert stand.end() == 2
    (line,) = stand.errors
    assert "exists already" in line


@pytest.mark.timeout(300)
def test_a_motor_is_configured_and_activated_by_hand(start: Start, root: Path) -> None:
    file = root / "atpid_driver" / "config" / "motor.yaml"
    given = ["--ros-args", "--params-file", file, "-p", "autostart:=false", "-p", "initial_height:=0.05"]
    motor = start(sys.executable, "-m", "atpid_driver.nodes.motor_node", *given)
    configured = start("atpid", "ros", "lifecycle", "/motor_node", "configure")
    assert configured.end() == 0
    assert configured.lines[-1] == "/motor_node: inactive"
    state = start("atpid", "ros", "echo", "/ceiling/state", "--once")
    assert state.end() == 0
    message = yaml.safe_load("\n".join(state.lines[:-1]))
    assert state.lines[-1] == "---"
    assert (message["mode"], message["height"]) == (1, 0.05)
    again = start("atpid", "ros", "lifecycle", "/motor_node", "configure")
    assert again.end() == 2
    assert again.errors[-1] == "error: /motor_node did not configure and is inactive; its log has the reason"
    assert start("atpid", "ros", "lifecycle", "/motor_node", "activate").end() == 0
    assert motor.end(signal.SIGINT) == 0


@pytest.mark.timeout(300)
def test_the_messages_of_a_sensor_are_printed(start: Start, root: Path) -> None:
    file = root / "atpid_driver" / "config" / "labjack.yaml"
    given = ["--ros-args", "--params-file", file, "-p", "handshake:=false", "-p", "backend:=simulated"]
    laser = start(sys.executable, "-m", "atpid_driver.nodes.labjack_node", *given)
    diagnostics = start("atpid", "ros", "echo", "/diagnostics", "--once")
    assert diagnostics.end() == 0
    statuses = yaml.safe_load("\n".join(diagnostics.lines[:-1]))["status"]
    names = ["acquisition", "support_displacement", "beam_displacement"]
    assert [status["name"] for status in statuses] == [f"labjack_node: {name}" for name in names]
    data = start("atpid", "ros", "echo", "/sensors/laser", "--field", "data")
    data.wait_for("---")
    assert data.end(signal.SIGINT) == 0
    assert len(yaml.safe_load("\n".join(data.lines[: data.lines.index("---")]))) == 100
    wrong = start("atpid", "ros", "echo", "/sensors/laser", "--field", "volts")
    assert wrong.end() == 2
    assert wrong.errors[-1].startswith("error: --field: given volts; ")
    assert laser.end(signal.SIGINT) == 0


@pytest.mark.timeout(300)
def test_a_topic_without_a_publisher_is_waited_for_with_a_line(start: Start) -> None:
    echo = start("atpid", "ros", "echo", "/nothere")
    echo.wait_for("waiting for a publisher of /nothere")
    assert echo.end(signal.SIGINT) == 0


@pytest.mark.timeout(300)
def test_a_replay_node_alone_logs_what_it_waits_for(start: Start, root: Path) -> None:
    bag = root / "bags" / "thesis_4_3_short"
    replay = start(
        sys.executable, "-m", "atpid_control.nodes.replay_node", "--ros-args", "-p", f"bag:={bag}", "-p", "rate:=0.0"
    )
    replay.wait_for("waiting for an answer on ceiling/command; not running: identifier_node, selector_node")
    assert replay.end(signal.SIGINT) == 0
