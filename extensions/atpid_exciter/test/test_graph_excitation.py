# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole graph with a commanded excitation: the plant follows the excitation node's states; a dead node is named."""

import math
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import ExcitationCommand, ExcitationState
from graph_runs import in_lockstep, in_real_time, scene_file, without_domain
from rclpy.node import Node
from test_graph_real_time import children

from atpid_common.nodes.messages import time_of
from atpid_control.runs.read import Bag, open_bag
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.stand.parameters import NodeDiedError

F = 5.4
SCENE = Path(__file__).resolve().parents[3] / "scenes/stand_realtime.yaml"


def commanded(folder: Path, **changes: Any) -> Path:
    own = {"excitation": {"commanded": True, "amplitude": 0.03, "frequency": F}} | changes
    return scene_file(SCENE, folder, **own)


class Operator:
    """Publishes commands at times of the run; its node is made in the run's own context."""

    def __init__(self, plan: list[tuple[float, dict[str, Any]]]) -> None:
        self._plan, self._sequence = plan, 0
        self._node: Node | None = None
        self._current: dict[str, Any] | None = None

    def __call__(self, reached: float) -> None:
        if self._node is None:
            self._node = Node("operator", start_parameter_services=False, enable_rosout=False)
            self._commands = self._node.create_publisher(ExcitationCommand, "excitation/command", 10)
        while self._plan and self._plan[0][0] <= reached:
            self._current, self._sequence = self._plan.pop(0)[1], self._sequence + 1
        if self._current is not None:
            message = ExcitationCommand(sequence=self._sequence, **self._current)
            message.header.stamp = time_of(round(reached * 1e9))
            self._commands.publish(message)


def series(bag: Bag, name: str) -> np.ndarray:
    return np.concatenate([np.asarray(getattr(message, name)) for _, message in bag.messages("/plant/truth")])


def test_in_lockstep_the_plant_follows_the_states_and_without_a_command_stands_still(tmp_path: Path) -> None:
    sine = {"kind": ExcitationCommand.SINE, "amplitude": 0.02, "frequency": F}
    bag = in_lockstep(
        commanded(tmp_path, duration=8.0, steady_window=[7.5, 8.0]), tmp_path / "run",
        Operator([(1.0, sine), (4.0, sine | {"frequency": 5.0}), (6.0, {"kind": ExcitationCommand.OFF})]),
    )  # fmt: skip
    support, states = series(bag, "support"), [message for _, message in bag.messages("/excitation/state")]
    time = np.arange(len(support)) / 1000.0
    assert (support[time < 1.0] == 0.0).all()
    assert (support[time > 6.5] == 0.0).all()
    running = (time > 3.0) & (time < 4.0)
    fit = np.stack([np.sin(2 * np.pi * F * time[running]), np.cos(2 * np.pi * F * time[running])], axis=1)
    parts, residual = np.linalg.lstsq(fit, support[running], rcond=None)[:2]
    assert np.hypot(*parts) == pytest.approx(0.02, rel=1e-6)
    assert residual[0] < 1e-12
    # no jump: neither of the motion nor, beyond that of the ramps' kinks, of its velocity
    jerk = np.abs(np.diff(support, 2)) * 1e6
    assert jerk.max() < 1.3 * 0.02 * (2 * np.pi * F) ** 2 + 2.0 * 0.2 * 1e3
    modes = [state.mode for state in states]
    assert modes[0] == ExcitationState.OFF == modes[-1]
    assert {ExcitationState.RAMPING, ExcitationState.RUNNING} <= set(modes)  # the way down is within a block


class Killer:
    """Starts the operator's command, interrupts it a second after it excites, and kills the motor's node after it."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.words = ["atpid", "excite", str(path), "--amplitude", "0.02", "--frequency", "5.0", "--hold"]
        self.output = folder / "printed"
        self.running = self.ended = math.inf  # times of the run [s]
        self.killed = False
        self.process: subprocess.Popen[bytes] | None = None

    def __call__(self, reached: float) -> None:
        if self.process is None:
            environment = without_domain() | {"ROS_DOMAIN_ID": os.environ["ROS_DOMAIN_ID"], "PYTHONUNBUFFERED": "1"}
            with self.output.open("wb") as output:
                self.process = subprocess.Popen(self.words, stdout=output, env=environment)
        elif self.process.poll() is not None:
            self.ended = min(self.ended, reached)
            if reached > self.ended + 0.5 and not self.killed:  # once: more data may come before its end is seen
                self.killed = True
                os.kill(children(os.getpid())["motor_node"], signal.SIGKILL)
        elif "running: " in self.output.read_text():
            self.running = min(self.running, reached)
            if reached > self.running + 1.0:
                self.process.send_signal(signal.SIGINT)


def test_an_operator_excites_until_ctrl_c(tmp_path: Path) -> None:
    path = commanded(tmp_path, duration=120.0, steady_window=[119.0, 120.0])  # it is ended before
    killer = Killer(path, tmp_path)
    with pytest.raises(NodeDiedError, match=r"motor_node.*-9"):
        in_real_time(path, tmp_path / "run", killer)
    assert killer.process is not None
    assert killer.process.poll() == 0
    assert "running: 0.02 at 5.0000 Hz" in killer.output.read_text()
    bag = open_bag(tmp_path / "run" / "bag")
    amplitudes = [message.excitation_amplitude for _, message in bag.messages("/plant/truth")]
    assert max(amplitudes) == pytest.approx(0.02, rel=0.02)
    assert amplitudes[-1] == 0.0
    # what is read from the bag has the tone that was put out in place of the scene's
    scene = open_run(bag.path).scene
    assert scene is not None
    assert not scene.excitation.is_commanded
    assert scene.excitation.largest_amplitude == pytest.approx(0.02, rel=0.02)
    assert scene.frequency_hz == pytest.approx(5.0, rel=0.01)
    assert verify(bag.path).by_topic["/sensors/laser"] > 0
