# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The stand's own graph without hardware: vendor package, real firmware, simulated physics; and it damps."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_runs import scene_file, without_domain

from atpid_control.analysis.signals import signals_of
from atpid_control.runs.run import open_run
from atpid_driver.emulator import missing_tools
from atpid_sim.scene import load_scene

pytestmark = pytest.mark.slow

SCENE = {
    "excitation": {"amplitude": [[0.0, 0.0], [0.5, 0.015], [8.0, 0.015]], "frequency": "resonance"},
    "duration": 8.0,
    "steady_window": [6.0, 8.0],
}


def bench(scene: Path, out: Path, *more: str) -> tuple[dict[str, Any], str]:
    """Run the bench as a user would; return its summary and what it printed."""
    command = ["atpid", "bench", str(scene), "--out", str(out), *more]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500.0, env=without_domain())
    assert done.returncode == 0, done.stderr
    return json.loads((out / "summary.json").read_text()), done.stdout + done.stderr


def test_the_emulated_stand_damps_as_the_simulated_bench_does(scenes: Path, tmp_path: Path) -> None:
    path = scene_file(scenes / "thesis_4_3.yaml", tmp_path, **SCENE)
    simulated, _ = bench(path, tmp_path / "simulated")
    emulated, printed = bench(path, tmp_path / "emulated", "--emulated-stand")
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        assert "left out: the firmware" in printed
    else:
        assert "left out" not in printed
    expected, seen = simulated["stages"][-1], emulated["stages"][-1]
    assert seen["height"] == pytest.approx(expected["height"], abs=0.01)
    assert seen["identified_amplitude"] == pytest.approx(0.015, rel=0.01)
    assert seen["efficiency"] == pytest.approx(expected["efficiency"], abs=0.03)
    assert emulated["lost_scans"] == 0
    first = signals_of(open_run(tmp_path / "emulated" / "bag"))[0].response[:100]
    assert np.ptp(first) < 0.5 * load_scene(path).static_deflection  # no step where the plant takes over from the feed
