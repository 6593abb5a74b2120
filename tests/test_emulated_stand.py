# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stand's own graph without hardware: vendor package, real firmware, simulated physics; and it damps.

A known motion that fails ends the run; in lockstep there is none. One that passes: `first-run`'s, and its test.
"""

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from graph_runs import scene_file, wait_until
from motor_rigs import words
from test_graph_force import CHANGES, FORCE

from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.runs.run import open_run
from atpid_control.stand.domain import own_domain
from atpid_control.stand.errors import NodeDiedError
from atpid_control.stand.parameters import write_parameters
from atpid_control.stand.parts import NODES
from atpid_control.stand.processes import Processes
from atpid_control.stand.running import commands_of
from atpid_driver.emulator import missing_tools
from atpid_sim.scene import load_scene

#: What changes in the thesis's scene, and the amplitude of what drives it: a support that a laser reads, or a force,
#: so that the device reads a load cell beside a laser.
SCENES: dict[str, tuple[dict[str, Any], float]] = {
    "support": ({"excitation": {"amplitude": [[0.0, 0.0], [0.5, 0.015]], "frequency": "resonance"}}, 0.015),
    "force": ({name: value for name, value in CHANGES.items() if name != "further_modes"}, FORCE),
}


def bench(scene: Path, out: Path, *more: str) -> dict[str, Any]:
    """Run the bench as a user would; return its summary."""
    assert main(["bench", str(scene), "--out", str(out), *more]) == 0
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


@pytest.mark.parametrize("drive", SCENES)
def test_the_emulated_stand_damps_as_the_simulated_bench_does(
    drive: str, scenes: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID")  # the bench claims one of its own
    drawn = SimpleNamespace(headline="", page="")  # the report is no subject here, and dear
    monkeypatch.setattr("atpid_control.views.report.make.write_report", lambda *_: drawn)
    changes, amplitude = SCENES[drive]
    changes = changes | {"duration": 5.0, "steady_window": [3.5, 5.0]}
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
    simulated = bench(path, tmp_path / "simulated")
    emulated = bench(path, tmp_path / "emulated", "--emulated-stand")
    printed = capfd.readouterr().err
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
    assert ("left out" in printed) is bool(missing_tools())
    expected, seen = simulated["stages"][-1], emulated["stages"][-1]
    assert seen["height"] == pytest.approx(expected["height"], abs=0.01)
    assert seen["identified_amplitude"] == pytest.approx(amplitude, rel=2e-3 if drive == "force" else 0.01)
    assert emulated["drive"]["name"] == drive
    assert seen["efficiency"] == pytest.approx(expected["efficiency"], abs=0.03)
    assert emulated["lost_scans"] == 0
    first = signals_of(open_run(tmp_path / "emulated" / "bag"))[0].response[:100]
    # no step where the plant takes over from the feed
    assert np.abs(np.diff(first)).max() < 0.5 * load_scene(path).static_deflection


def test_a_motor_that_moves_at_another_speed_ends_its_process_with_one_line_and_status_2(tmp_path: Path) -> None:
    slow = {"check_move": 0.1, "initial_height": 0.017, "faults": ["motor slow 0 1000 0.5"]}
    write_parameters({"motor_node": NODES["motor_node"].configured() | slow}, tmp_path / "parameters.yaml")
    commands = [command for command in commands_of(tmp_path / "parameters.yaml") if command[0] == "motor_node"]
    with own_domain(), Processes(commands, tmp_path) as nodes:
        wait_until(lambda: nodes["motor_node"].status is not None)
        with pytest.raises(NodeDiedError, match=r"motor_node.* 2.* 0\.017 to 0\.117 m.* 0\.3 m/s .*25%.* 0\.1"):
            nodes.check("")


def test_in_lockstep_it_is_refused(scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", str(scenes / "thesis_4_3.yaml"), "--out", str(tmp_path / "out"), "--move", "0.1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: --move: ")
    assert {"0.1", "emulated", "time"} <= words(line)
