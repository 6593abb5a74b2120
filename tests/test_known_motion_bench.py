# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The known motion before a run in the real-time bench: announced, made before the first sample; or the run ends."""

from pathlib import Path
from typing import Any

import pytest
from graph_runs import parameters, scene_file, wait_until

from atpid_control.cli import main
from atpid_control.runs.read import Bag, open_bag
from atpid_control.stand.domain import own_domain
from atpid_control.stand.errors import NodeDiedError
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import NODES
from atpid_control.stand.processes import Processes
from atpid_control.stand.running import commands_of, run_realtime

SHORT = {"duration": 1.0, "steady_window": [0.5, 1.0], "amplitude": [[0.0, 0.0], [0.5, 0.015]]}


def run(scenes: Path, folder: Path, **motor: Any) -> Bag:
    _, given = parameters(scene_file(scenes / "thesis_4_3.yaml", folder, **SHORT), folder, lockstep=False)
    given["motor_node"] |= {"check_move": 0.1} | motor
    write_parameters(given, folder / "parameters.yaml")
    with own_domain():
        run_realtime(commands_of(folder / "parameters.yaml"), folder, lambda _: None)
    return open_bag(folder / "bag")


@pytest.mark.slow
def test_the_ceiling_moves_before_the_run_and_is_back_when_it_begins(scenes: Path, tmp_path: Path) -> None:
    bag = run(scenes, tmp_path)
    events = [event.text for _, event in bag.messages("/events") if event.node == "motor_node"]
    assert events[0] == "known motion: in 1 s the ceiling moves from 0.017 to 0.117 m and back"
    # tried again where a busy machine withdrew the supervisor's permission meanwhile
    assert "known motion passed" in events, events[:10]
    first = next(when for when, block in bag.messages("/sensors/laser") if not block.handshake)
    before = [state for when, state in bag.messages("/ceiling/state") if when < first and state.homed]
    assert max(state.height for state in before) == pytest.approx(0.117)
    assert before[-1].height == 0.017


@pytest.mark.slow
def test_a_motor_that_moves_at_another_speed_ends_its_process_with_one_line_and_status_2(tmp_path: Path) -> None:
    slow = {"check_move": 0.1, "initial_height": 0.017, "faults": ["motor slow 0 1000 0.5"]}
    write_parameters({"motor_node": NODES["motor_node"].configured() | slow}, tmp_path / "parameters.yaml")
    commands = [command for command in commands_of(tmp_path / "parameters.yaml") if command[0] == "motor_node"]
    with own_domain(), Processes(commands, tmp_path) as nodes:
        wait_until(lambda: nodes["motor_node"].status is not None)
        expected = "known motion: commanded 0.017 to 0.117 m; expected 0.3 m/s within 25%, found at most 0.1"
        with pytest.raises(NodeDiedError, match=f"motor_node ended with status 2.*{expected}"):
            nodes.check("")


def test_in_lockstep_it_is_refused(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", str(scenes / "thesis_4_3.yaml"), "--out", str(tmp_path / "out"), "--move", "0.1"]) == 2
    assert capsys.readouterr().err == "error: --move: given 0.1; allowed: with --real-time or --emulated-stand\n"
