# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The whole loop with a structure of several modes that a force drives: bench, replay, report, validation."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_runs import scene_file

from atpid_control.cli import main
from atpid_control.runs.run import Run, open_run
from atpid_sim.scene import load_scene
from atpid_sim.simulation.simulate import simulate

FORCE, NOISE = 4.0, 0.02
#: The thesis's beam in three modes, a force at three quarters of its length (`atpid modes cantilever`).
CHANGES: dict[str, Any] = {
    "beam": {"mass": 0.3243227, "frequency": 5.783347, "damping_ratio": 0.024},
    "further_modes": [
        {"mass": 2.392973, "frequency": 55.94404, "damping_ratio": 0.024, "drive_factor": -4.598859},
        {"mass": 6.153679, "frequency": 174.0732, "damping_ratio": 0.024, "drive_factor": -9.546442},
    ],
    "drive": "force",
    "excitation": {"amplitude": [[0.0, 0.0], [0.5, FORCE]], "frequency": "resonance"},
    "ceiling": {"closed": 0.017, "range": [0.017, 1.0], "speed": 0.3, "controller": "lookup"},
    "duration": 9.0,
    "steady_window": [7.0, 9.0],
    "sensors": {"laser": {"noise": 2e-5}, "load_cell": {"noise": NOISE, "saturation": [-20.0, 20.0]}},
}


@pytest.fixture(scope="module")
def path(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scene_file(scenes / "thesis_4_3.yaml", tmp_path_factory.mktemp("scene"), **CHANGES)


@pytest.fixture(scope="module")
def out(path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("bench") / "run"
    assert main(["bench", str(path), "--out", str(made)]) == 0
    return made


@pytest.fixture(scope="module")
def run(out: Path) -> Run:
    return open_run(out / "bag")


def response(path: Path, omega: float, grain: float) -> float:
    """The container's amplitude for a unit of the force, of the coupled equations."""
    scene = load_scene(path)
    parts = [(scene.beam, 1.0), *((mode, mode.drive_factor) for mode in scene.further_modes)]
    mass = np.diag([mode.mass for mode, _ in parts]) + grain
    stiffness, damping = (np.diag([getattr(mode, key) for mode, _ in parts]) for key in ("stiffness", "damping"))
    resistance = stiffness - omega**2 * mass + 1j * omega * damping
    return float(abs(np.linalg.solve(resistance, [factor for _, factor in parts]).sum()))


def test_the_loop_identifies_the_force_and_damps(path: Path, out: Path) -> None:
    summary, scene = json.loads((out / "summary.json").read_text()), load_scene(path)
    assert summary["drive"] == {"name": "force", "channel": "drive_force", "unit": "N"}
    stage, omega = summary["stages"][-1], 2.0 * np.pi * scene.frequency_hz
    assert stage["identified_amplitude"] == pytest.approx(FORCE, rel=1e-3)
    assert stage["bare_amplitude"] == pytest.approx(FORCE * response(path, omega, 0.0), rel=1e-9)
    assert stage["undamped_amplitude"] == pytest.approx(FORCE * response(path, omega, scene.grain_mass), rel=0.01)
    alone = simulate(scene.with_(height=stage["height"], amplitude=FORCE, duration=30.0, steady_window=[26.0, 30.0]))
    assert stage["amplitude"] == pytest.approx(alone.amplitude, rel=0.02)
    assert stage["efficiency"] > 0.7
    assert [mode["frequency"] for mode in summary["modes"]] == pytest.approx([5.783347, 55.94404, 174.0732], rel=1e-9)
    modes = (scene.beam, *scene.further_modes)
    mass = np.diag([mode.mass for mode in modes]) + scene.grain_mass
    held = np.linalg.eigvals(np.linalg.solve(mass, np.diag([mode.stiffness for mode in modes])))
    expected = np.sort(np.sqrt(held.real)) / (2.0 * np.pi)
    assert [mode["held_frequency"] for mode in summary["modes"]] == pytest.approx(expected, rel=1e-9)


def test_what_drives_has_its_own_channel_and_unit(run: Run) -> None:
    assert run.drive.unit == "N"
    measured, true = run.signal("drive_force"), run.signal("drive_force", origin="truth")
    assert (measured.unit, true.unit) == ("N", "N")
    assert float(np.std(measured.values - true.values)) == pytest.approx(NOISE, rel=0.05)
    assert np.abs(true.values[-1000:]).max() == pytest.approx(FORCE, rel=1e-3)
    tree = run.tree()
    in_newton = {
        "excitation": ("amplitude", "amplitude_std", "offset", "residual"), "plant/truth": ("support",),
        "plant/truth_blocks": ("excitation_amplitude",), "ceiling/command": ("excitation_amplitude",),
    }  # fmt: skip
    for topic, names in in_newton.items():
        assert {name: tree[topic][name].attrs["units"] for name in names} == dict.fromkeys(names, "N")
    assert tree["excitation"]["beam_amplitude"].attrs["units"] == "m"
    changed = [event.text for event in run.events if event.kind == "excitation_changed"]
    assert changed
    assert all(" N at " in text for text in changed)
    assert run.ledger is not None
    assert abs(run.ledger.residual) < 1e-4


def test_a_replay_of_a_force_answers_alike(out: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(out / "bag"), "--out", str(tmp_path / "again")]) == 0
    printed = capfd.readouterr().out
    agreeing = re.findall(r"(\S+): (\d+) of (\d+)", printed)
    assert agreeing == [("/excitation", "180", "180"), ("/ceiling/command", "180", "180")]


def test_a_recorded_force_drives_its_simulation(out: Path, tmp_path: Path) -> None:
    assert main(["bag", "validate", str(out / "bag"), "--out", str(tmp_path / "beside")]) == 0
    found = json.loads((tmp_path / "beside" / "agreement.json").read_text())
    assert found["relative_rmse"] < 0.02


def test_runs_under_force_and_support_are_not_compared_by_excitation(
    out: Path, tmp_path: Path, root: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    both = [str(out / "bag"), str(root / "bags/thesis_4_3_short")]
    assert main(["bag", "compare", *both, "--out", str(tmp_path / "both")]) == 0
    printed = capfd.readouterr().out
    assert {"excitations", "not", "compared"} <= set(re.findall(r"\w+", printed))
    assert not re.search(r"excitation, \w", printed)
