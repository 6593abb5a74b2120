# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stand's own graph without hardware: vendor package, real firmware, simulated physics; and it damps."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_runs import scene_file
from test_graph_force import CHANGES, FORCE

from atpid_control.analysis.signals import signals_of
from atpid_control.cli import main
from atpid_control.runs.run import open_run
from atpid_driver.emulator import missing_tools
from atpid_sim.scene import load_scene

pytestmark = pytest.mark.slow

#: What changes in the thesis's scene, and the amplitude of what drives it: a support that a laser reads, or a force,
#: so that the device reads a load cell beside a laser.
SCENES: dict[str, tuple[dict[str, Any], float]] = {
    "support": ({"excitation": {"amplitude": [[0.0, 0.0], [0.5, 0.015]], "frequency": "resonance"}}, 0.015),
    "force": ({name: value for name, value in CHANGES.items() if name != "further_modes"}, FORCE),
}


@pytest.fixture(autouse=True)
def any_domain(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bench of a test claims a domain of its own: the session holds the one it has set."""
    monkeypatch.delenv("ROS_DOMAIN_ID")


def bench(scene: Path, out: Path, *more: str) -> dict[str, Any]:
    """Run the bench as a user would; return its summary."""
    assert main(["bench", str(scene), "--out", str(out), *more]) == 0
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


@pytest.mark.parametrize("drive", SCENES)
def test_the_emulated_stand_damps_as_the_simulated_bench_does(
    drive: str, scenes: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    changes, amplitude = SCENES[drive]
    changes = changes | {"duration": 6.0, "steady_window": [4.0, 6.0]}
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **changes)
    simulated = bench(path, tmp_path / "simulated")
    emulated = bench(path, tmp_path / "emulated", "--emulated-stand")
    printed = capfd.readouterr().err
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        assert "left out: the firmware" in printed
    else:
        assert "left out" not in printed
    expected, seen = simulated["stages"][-1], emulated["stages"][-1]
    assert seen["height"] == pytest.approx(expected["height"], abs=0.01)
    assert seen["identified_amplitude"] == pytest.approx(amplitude, rel=2e-3 if drive == "force" else 0.01)
    assert emulated["drive"]["name"] == drive
    assert seen["efficiency"] == pytest.approx(expected["efficiency"], abs=0.03)
    assert emulated["lost_scans"] == 0
    first = signals_of(open_run(tmp_path / "emulated" / "bag"))[0].response[:100]
    # no step where the plant takes over from the feed
    assert np.abs(np.diff(first)).max() < 0.5 * load_scene(path).static_deflection
