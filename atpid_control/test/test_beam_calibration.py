# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Beam parameters are recovered from simulated decays and sweeps with noise, and what cannot be told is not told."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from atpid_common.errors import InputError
from atpid_control.analysis.beam.fit import BeamCalibrationError, BeamFit, fit_beam, forced, free_columns
from atpid_control.analysis.beam.masses import from_added_mass, from_known_mass
from atpid_control.analysis.signals import Signals
from atpid_control.commands import calibrate_beam as command
from atpid_sim.scene import Scene, load_scene
from atpid_sim.simulation.simulate import trajectory

ROOT = Path(__file__).parents[2]
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


def fitted(recording: Signals) -> BeamFit:
    return fit_beam(recording)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [LASER, 5e-4])
@pytest.mark.parametrize("scene", [DECAY, SWEEP], ids=["decay", "sweep"])
def test_all_three_are_recovered_within_a_per_cent_with_a_known_mass(scene: Scene, noise: float) -> None:
    fit = fitted(recorded(scene, noise=noise))
    assert fit.driven == (scene is SWEEP)
    found = from_known_mass(fit, MOVING, grain_mass=CLOSED.grain_mass)
    assert found.mass == pytest.approx(CLOSED.beam.mass, rel=1e-9)
    assert found.stiffness == pytest.approx(CLOSED.beam.stiffness, rel=0.001)
    assert found.damping == pytest.approx(CLOSED.beam.damping, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [DECAY, SWEEP], ids=["decay", "sweep"])
def test_an_added_mass_determines_all_three(scene: Scene) -> None:
    plain, loaded = fitted(recorded(scene, 1)), fitted(recorded(with_mass(scene, 0.05), 2))
    found = from_added_mass(plain, loaded, 0.05, CLOSED.grain_mass)
    assert found.mass == pytest.approx(CLOSED.beam.mass, rel=0.01)
    assert found.stiffness == pytest.approx(CLOSED.beam.stiffness, rel=0.01)
    assert found.damping == pytest.approx(CLOSED.beam.damping, rel=0.01)
    assert 0.0 < found.mass_std < 0.01 * found.mass


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
    for beam, text in (
        (trajectory(opened, RATE).beam, "none of one mass"),
        (rng.normal(0.0, 1.0, 5000), "none of one mass"),
        (np.zeros(5000), "does not move"),
        (np.full(5000, np.nan), "0 valid samples"),
        (np.sin(40.0 * t)[:20], "20 valid samples"),
    ):
        with pytest.raises(BeamCalibrationError, match=text):
            fit_beam(alone(beam))
    with pytest.raises(BeamCalibrationError, match="support: given a recording with gaps"):
        fit_beam(Signals(RATE, np.where(t > 1.0, 0.0, np.nan), np.sin(40.0 * t)))


def test_impossible_masses_are_refused() -> None:
    fit, loaded = fitted(recorded(DECAY, 1)), fitted(recorded(with_mass(DECAY, 0.05), 2))
    with pytest.raises(BeamCalibrationError, match="must be slower"):
        from_added_mass(loaded, fit, 0.05)
    with pytest.raises(BeamCalibrationError, match="added mass: given -1 kg"):
        from_added_mass(fit, loaded, -1.0)
    with pytest.raises(BeamCalibrationError, match="grain mass: given 1 kg"):
        from_known_mass(fit, 0.362, grain_mass=1.0)
    with pytest.raises(BeamCalibrationError, match="moving mass: given 0 kg"):
        from_known_mass(fit, 0.0)


def write_table(recording: Signals, path: Path) -> Path:
    time = np.arange(recording.response.size) / recording.rate
    support = recording.excitation
    table = np.stack([time, support, recording.response], axis=1)
    np.savetxt(path, table, delimiter=",", header="time,support_displacement,beam_displacement", comments="")
    return path


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return command.run(parser.parse_args(list(arguments)))


def test_the_command_writes_a_beam_block_a_scene_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = write_table(recorded(DECAY), tmp_path / "decay.csv"), tmp_path / "beam.yaml"
    mass = ["--moving-mass", str(MOVING), "--grain-mass", str(CLOSED.grain_mass)]
    assert run(str(table), *mass, "--out", str(out)) == 0
    assert "natural frequency 5.4" in capsys.readouterr().out
    scene = CLOSED.with_(beam=yaml.safe_load(out.read_text(encoding="utf-8"))["beam"])
    assert scene.beam.stiffness == pytest.approx(427.6, rel=0.001)
    assert scene.beam.mass == pytest.approx(CLOSED.beam.mass, rel=1e-6)
    assert run(str(table), *mass, "--json", "--from", "0.5", "--to", "8") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["beam"]["damping"] == pytest.approx(0.56, rel=0.01)
    assert said["beam"]["stiffness_std"] < 0.1


@pytest.mark.slow
def test_without_a_mass_the_command_prints_the_ratios_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = str(write_table(recorded(DECAY), tmp_path / "decay.csv"))
    assert run(table) == 0
    said = capsys.readouterr().out
    assert "k/m = 118" in said
    assert "cannot be separated" in said
    assert "beam:" not in said
    assert run(table, "--json") == 0
    assert json.loads(capsys.readouterr().out)["beam"] is None
    with pytest.raises(BeamCalibrationError, match="--out: a beam: block needs a mass"):
        run(table, "--out", str(tmp_path / "beam.yaml"))


def test_two_recordings_through_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain = write_table(recorded(DECAY, 1), tmp_path / "plain.csv")
    loaded = write_table(recorded(with_mass(DECAY, 0.05), 2), tmp_path / "loaded.csv")
    assert run(str(plain), "--with-added", str(loaded), "--added-mass", "0.05", "--json") == 0
    assert json.loads(capsys.readouterr().out)["beam"]["mass"] == pytest.approx(MOVING, rel=0.01)


def test_bad_recordings_and_arguments_are_refused(tmp_path: Path) -> None:
    table = write_table(recorded(DECAY), tmp_path / "decay.csv")
    bad = tmp_path / "bad.csv"
    for content, text in (
        ("", "no table of numbers"),
        ("t2,beam_displacement\n0,1\n1,2\n", "needed: time"),
        ("time,x\n0,1\n1,2\n", "no samples of beam_displacement; channels in it: x"),
        ("time,beam_displacement\n0,1\n1,2\n2,3\n3,4\nx,5\n5,6\n", "two finite times"),
        ("time,beam_displacement\n0,1\n1,2\n5,3\n", "not evenly sampled"),
        ("time,beam_displacement\n0,1\n", "no table of numbers"),
    ):
        bad.write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match=text):
            run(str(bad))
    for arguments, text in (
        ([str(tmp_path / "none.csv")], "no such file"),
        ([str(table), "--added-mass", "0.1"], "--added-mass and --with-added"),
        ([str(table), "--from", "20"], "--from 20"),
        ([str(table), "--from", "3", "--to", "2"], "--from 3 --to 2"),
    ):
        with pytest.raises(InputError, match=text) as refused:
            run(*arguments)
        assert "\n" not in str(refused.value)
