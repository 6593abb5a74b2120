# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A known motion that fails ends the run; in lockstep there is none. One that passes: `first-run`'s, and its test."""

from pathlib import Path

import pytest
from graph_runs import wait_until

from atpid_control.cli import main
from atpid_control.stand.domain import own_domain
from atpid_control.stand.errors import NodeDiedError
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import NODES
from atpid_control.stand.processes import Processes
from atpid_control.stand.running import commands_of


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
