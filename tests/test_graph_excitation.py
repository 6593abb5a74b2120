# SPDX-License-Identifier: Apache-2.0
"""The whole graph with a commanded excitation: the plant follows the excitation node's states, and nothing else."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from atpid_interfaces.msg import ExcitationCommand, ExcitationState
from graph_runs import in_lockstep, scene_file
from rclpy.node import Node

from atpid_common.nodes.messages import time_of
from atpid_control.runs.read import Bag

F = 5.4


def commanded(scenes: Path, folder: Path, **changes: Any) -> Path:
    excitation = {"commanded": True, "amplitude": 0.03, "frequency": F}
    own = {"excitation": excitation, "duration": 8.0} | changes
    own["steady_window"] = [own["duration"] - 0.5, own["duration"]]
    return scene_file(scenes / "stand_realtime.yaml", folder, **own)


class Operator:
    """Publishes commands at times of the run; its node is made in the run's own context."""

    def __init__(self, plan: list[tuple[float, dict[str, Any]]]) -> None:
        self._plan, self._node, self._sequence = plan, None, 0
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


def test_in_lockstep_the_plant_follows_the_states_and_without_a_command_stands_still(
    scenes: Path, tmp_path: Path
) -> None:
    sine = {"kind": ExcitationCommand.SINE, "amplitude": 0.02, "frequency": F}
    bag = in_lockstep(
        commanded(scenes, tmp_path), tmp_path / "run",
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
    assert {ExcitationState.RAMPING, ExcitationState.RUNNING, ExcitationState.STOPPING} <= set(modes)
    found = [message for _, message in bag.messages("/excitation/command")]
    assert [message.kind for message in found][-1] == ExcitationCommand.OFF


