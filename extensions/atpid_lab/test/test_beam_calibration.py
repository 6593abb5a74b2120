# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Beam parameters are recovered from simulated decays and sweeps with noise, as far as they are determined."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands_run import answered, printed, refusal
from numpy.typing import NDArray

from atpid_control.analysis.signals import Signals
from atpid_lab.beam.fit import BeamCalibrationError, fit_beam, forced, free_columns, from_added_mass, from_known_mass
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.simulate import trajectory

ROOT = Path(__file__).parents[3]
RATE, LASER = 1000.0, 20e-6
CLOSED = load_scene(ROOT / "scenes" / "closed_damper.yaml")
MOVING = CLOSED.total_mass
DECAY = CLOSED.with_(excitation={"free": {"deflection": 0.1}}, duration=10.0, steady_window=(0.0, 10.0))
SWEEP = CLOSED.with_(
    excitation={"sweep": {"amplitude": 0.002, "from": 3.0, "to": 8.0}}, duration=40.0, steady_window=(0.0, 40.0)
)


def recorded(scene: Scene, seed: int = 0, noise: float = LASER) -> Signals:
    """Return what the laser reads of a simulated run."""
    rng, motion = np.random.default_rng(seed), trajectory(scene, RATE)
    support, beam = (series + rng.normal(0.0, noise, series.size) for series in (motion.support, motion.beam))
    return Signals(RATE, support, beam)


def with_mass(scene: Scene, added: float) -> Scene:
    """Return the scene with `added` [kg] more on the beam, the grain as it is."""
    beam = {**scene.beam.model_dump(), "mass": scene.beam.mass + added}
    return scene.with_(beam=beam, mass_fraction=scene.grain_mass / (scene.total_mass + added))


def alone(beam: NDArray[np.float64]) -> Signals:
    """Return a beam whose support was not measured."""
    return Signals(RATE, np.full(beam.size, np.nan), beam)


@pytest.mark.parametrize(
    ("scene", "noise"), [(DECAY, LASER), (DECAY, 5e-4), (SWEEP, LASER)], ids=["decay", "noisy", "sweep"]
)
def test_all_three_are_recovered_within_a_per_cent_with_a_known_or_an_added_mass(scene: Scene, noise: float) -> None:
    fit = fit_beam(recorded(scene, noise=noise))
    assert fit.driven == (scene is SWEEP)
    found = [from_known_mass(fit, MOVING, grain_mass=CLOSED.grain_mass)]
    assert found[0].mass == pytest.approx(CLOSED.beam.mass, rel=1e-9)
    assert found[0].stiffness == pytest.approx(CLOSED.beam.stiffness, rel=0.001)
    if noise == LASER:
        loaded = fit_beam(recorded(with_mass(scene, 0.05), 2))
        found.append(from_added_mass(fit, loaded, 0.05, CLOSED.grain_mass))
        assert 0.0 < found[1].mass_std < 0.01 * found[1].mass
    for one in found:
        assert (one.mass, one.stiffness) == pytest.approx((CLOSED.beam.mass, CLOSED.beam.stiffness), rel=0.01)
        assert one.damping == pytest.approx(CLOSED.beam.damping, rel=0.01)


@pytest.mark.parametrize("noise", [LASER, 1e-3])
def test_error_bars_cover_the_error(noise: float) -> None:
    """Normalised errors of many decays have a spread of about one."""
    stiffness, damping, off = 427.6 / 0.362, 0.56 / 0.362, []
    motion = 0.1 * free_columns(6000, 1.0 / RATE, stiffness, damping)[0]
    for seed in range(40):
        rng = np.random.default_rng(seed)
        fit = fit_beam(alone(motion + rng.normal(0.0, noise, motion.size)))
        std = np.sqrt(np.diag(fit.covariance))
        off.append([(fit.stiffness - stiffness) / std[0], (fit.damping - damping) / std[1]])
    assert np.all(np.abs(np.std(off, axis=0) - 1.0) < 0.35)
    assert np.all(np.abs(np.mean(off, axis=0)) < 0.6)


def test_the_driven_response_is_exact_for_a_straight_input() -> None:
    """From rest under a ramp of the support: the beam follows it but for a free motion, in closed form."""
    stiffness, damping, step = 1000.0, 3.0, 0.004
    t: NDArray[np.float64] = np.arange(2000, dtype=np.float64) * step
    omega = np.sqrt(stiffness - 0.25 * damping**2)
    exact = t - np.exp(-0.5 * damping * t) * np.sin(omega * t) / omega
    np.testing.assert_allclose(forced(t, step, stiffness, damping), exact, atol=1e-9)


def test_lost_samples_of_the_beam_do_no_harm() -> None:
    recording = recorded(DECAY)
    beam = np.where(np.random.default_rng(3).random(recording.response.size) < 0.1, np.nan, recording.response)
    beam[2000:2300] = np.nan
    fit = fit_beam(replace(recording, response=beam))
    assert fit.stiffness * MOVING == pytest.approx(427.6, rel=0.001)


def test_what_is_no_beam_of_one_mass_is_refused() -> None:
    rng, t = np.random.default_rng(4), np.arange(5000) / RATE
    opened = load_scene(ROOT / "scenes" / "free_decay.yaml")
    for beam, word in (
        (trajectory(opened, RATE).beam, "mass"),
        (rng.normal(0.0, 1.0, 5000), "mass"),
        (np.zeros(5000), "move"),
        (np.full(5000, np.nan), r"\b0 valid"),
        (np.sin(40.0 * t)[:20], r"\b20 valid"),
    ):
        with pytest.raises(BeamCalibrationError, match=word):
            fit_beam(alone(beam))
    with pytest.raises(BeamCalibrationError, match=r"^support: .*gaps"):
        fit_beam(Signals(RATE, np.where(t > 1.0, 0.0, np.nan), np.sin(40.0 * t)))


def test_impossible_masses_are_refused() -> None:
    fit, loaded = fit_beam(recorded(DECAY, 1)), fit_beam(recorded(with_mass(DECAY, 0.05), 2))
    with pytest.raises(BeamCalibrationError, match="slower"):
        from_added_mass(loaded, fit, 0.05)
    with pytest.raises(BeamCalibrationError, match=r"^added .* -1 kg"):
        from_added_mass(fit, loaded, -1.0)
    with pytest.raises(BeamCalibrationError, match=r"^grain .* 1 kg"):
        from_known_mass(fit, 0.362, grain_mass=1.0)
    with pytest.raises(BeamCalibrationError, match=r"^moving .* 0 kg"):
        from_known_mass(fit, 0.0)


COMMAND = ("calibrate", "beam")
MASS = ("--moving-mass", MOVING, "--grain-mass", CLOSED.grain_mass)
Capture = pytest.CaptureFixture[str]


def write_table(recording: Signals, path: Path) -> Path:
    time = np.arange(recording.response.size) / recording.rate
    table = np.stack([time, recording.excitation, recording.response], axis=1)
    np.savetxt(path, table, delimiter=",", header="time,support_displacement,beam_displacement", comments="")
    return path


def test_the_command_writes_a_beam_block_a_scene_takes(tmp_path: Path, capsys: Capture) -> None:
    decay, out = write_table(recorded(DECAY, 1), tmp_path / "decay.csv"), tmp_path / "beam.yaml"
    assert re.search(r"5\.4\d* Hz", printed(capsys, *COMMAND, decay, *MASS, "--out", out))
    scene = CLOSED.with_(beam=yaml.safe_load(out.read_text(encoding="utf-8"))["beam"])
    assert scene.beam.stiffness == pytest.approx(427.6, rel=0.001)
    assert scene.beam.mass == pytest.approx(CLOSED.beam.mass, rel=1e-6)
    part = answered(capsys, *COMMAND, decay, *MASS, "--from", "0.5", "--to", "8")
    assert part["beam"]["damping"] == pytest.approx(0.56, rel=0.01)
    assert part["beam"]["stiffness_std"] < 0.1
    # without a mass the ratios only; a second recording with an added one determines it
    assert "k/m = 118" in printed(capsys, *COMMAND, decay)
    assert answered(capsys, *COMMAND, decay)["beam"] is None
    assert "--out" in refusal(capsys, *COMMAND, decay, "--out", out)
    loaded = write_table(recorded(with_mass(DECAY, 0.05), 2), tmp_path / "loaded.csv")
    found = answered(capsys, *COMMAND, decay, "--with-added", loaded, "--added-mass", "0.05")
    assert found["beam"]["mass"] == pytest.approx(MOVING, rel=0.01)


def test_bad_recordings_and_arguments_are_refused(tmp_path: Path, capsys: Capture) -> None:
    bad, header = tmp_path / "bad.csv", "time,beam_displacement\n"
    decay = write_table(recorded(DECAY, 1), tmp_path / "decay.csv").read_text()
    cases: list[tuple[str, list[str], list[str]]] = [
        (f"{header}0,1\n", [], ["numbers"]),
        ("t2,beam_displacement\n0,1\n1,2\n", [], ["time"]),
        ("time,x\n0,1\n1,2\n", [], ["beam_displacement", ": x"]),
        (f"{header}0,1\n1,2\n2,3\n3,4\nx,5\n5,6\n", [], ["finite"]),
        (f"{header}0,1\n1,2\n5,3\n", [], ["evenly"]),
        (decay, ["--added-mass", "0.1"], ["--added-mass", "--with-added"]),
        (decay, ["--from", "20"], ["--from 20"]),
        (decay, ["--from", "3", "--to", "2"], ["--from 3 --to 2"]),
    ]
    for content, arguments, words in cases:
        bad.write_text(content, encoding="utf-8")
        line = refusal(capsys, *COMMAND, bad, *arguments)
        assert [word for word in words if word not in line] == []
    assert "none.csv" in refusal(capsys, *COMMAND, tmp_path / "none.csv")
