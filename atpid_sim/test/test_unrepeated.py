# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `simulate` measures of motions that do not repeat: root mean squares with errors, spectra, peaks of a shock."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sim_program import main

from atpid_sim.scene import Scene, standard_bench
from atpid_sim.simulation.simulate import simulate
from atpid_sim.simulation.unrepeated import mean_error, vibration, write_spectrum
from atpid_sim.system import Array

POINTS = ((2.0, 0.2), (8.0, 0.8), (20.0, 0.1))
RANDOM = {"random": {"psd": [list(point) for point in POINTS], "unit": "(m/s^2)^2/Hz"}}


def shaken(seconds: float = 60.0, height: float = 0.017, **changes: Any) -> Scene:
    """Return the standard bench under a random motion, measured for so long after 8 s, in which a start has faded."""
    given = {"excitation": RANDOM, "duration": 8.0 + seconds, "steady_window": [8.0, 8.0 + seconds], "tolerance": 1e-3}
    return standard_bench(**(given | {"ceiling": {"height": height}} | changes))


def density(scene: Scene, frequency: Array, mass: float) -> Array:
    """|H|^2 S of the beam's displacement [m^2/Hz], from the acceleration's points."""
    omega, beam = 2.0 * np.pi * frequency, scene.beam
    asked = np.exp(np.interp(np.log(frequency), *np.log(np.array(POINTS).T)))
    asked = np.where((frequency >= 2.0) & (frequency <= 20.0), asked, 0.0) / omega**4
    support = beam.stiffness + 1j * beam.damping * omega
    return np.asarray(asked * np.abs(support / (support - mass * omega**2)) ** 2)


def exact_rms(scene: Scene, mass: float) -> float:
    frequency = np.geomspace(2.0, 20.0, 100_001)
    return float(np.sqrt(np.trapezoid(density(scene, frequency, mass), frequency)))


def test_the_closed_damper_has_the_closed_form_s_root_mean_square_within_its_error() -> None:
    off = []
    for seed in range(10):
        scene = shaken(seed=seed)
        found = simulate(scene, "simplified", check=False)
        closed, bare = (exact_rms(scene, mass) for mass in (scene.total_mass, scene.beam.mass))
        assert found.rms == found.undamped_rms
        assert (found.efficiency_rms, found.efficiency_rms_error) == (0.0, 0.0)
        assert found.bare_rms == pytest.approx(bare, rel=0.25)
        off.append((found.rms - closed) / found.rms_error)
        off.append((found.reduction_rms - (1.0 - closed / bare)) / found.reduction_rms_error)
        assert 20.0 < found.independent_samples < 150.0
    assert 0.6 < np.std(off) < 1.5
    assert np.abs(off).max() < 3.5


def test_the_spectrum_is_that_of_the_closed_form(tmp_path: Path) -> None:
    """Bands of 1 Hz of Welch's estimate over 240 s: 240 independent values and more, 6 % each."""
    scene = shaken(240.0, seed=1, beam={"mass": 0.3258, "frequency": 5.7, "damping_ratio": 0.1})
    write_spectrum(vibration(scene, "simplified"), tmp_path / "s.csv", scene.driven_by)
    header = (tmp_path / "s.csv").read_text().splitlines()[0]
    assert header == "frequency,support_displacement,beam_displacement,beam_damper_closed,beam_without_damper"
    frequency, support, beam, closed, bare = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=1).T
    assert np.array_equal(beam, closed)
    for series, mass in ((support, 0.0), (closed, scene.total_mass), (bare, scene.beam.mass)):
        for low in range(3, 19):
            band = (frequency >= low) & (frequency < low + 1)
            expected = density(scene, frequency[band], mass)
            assert np.mean(series[band]) == pytest.approx(np.mean(expected), rel=4 * 0.065)
    inside = (frequency > 3.0) & (frequency < 19.0)
    ratio = density(scene, frequency[inside], scene.total_mass) / density(scene, frequency[inside], 0.0)
    assert closed[inside] / support[inside] == pytest.approx(ratio, rel=0.05)


def test_the_reduction_by_the_damper_repeats_over_seeds_within_its_error() -> None:
    found = [simulate(shaken(height=0.06, seed=seed), "impact", check=False) for seed in range(5)]
    values, errors = (np.array([getattr(one, f"reduction_rms{end}") for one in found]) for end in ("", "_error"))
    assert values.min() > 0.0
    assert errors.max() < 0.1
    mean = np.average(values, weights=errors**-2.0)
    assert 0.1 < np.sum(((values - mean) / errors) ** 2) < 13.3  # chi squared of 4: 0.1 % and 99 %
    for one in found:
        assert one.motion == "random"
        assert one.efficiency_rms == pytest.approx(1.0 - one.rms / one.undamped_rms, rel=1e-12)
        assert one.reduction_rms == pytest.approx(1.0 - one.rms / one.bare_rms, rel=1e-12)


def test_errors_of_correlated_values_are_those_of_their_mean() -> None:
    """x' = 0.8 x + normal: the standard error of the mean is 5 / sqrt(n), the correlation time 9 values."""
    random = np.random.default_rng(0)
    steps = random.standard_normal((200, 2100))
    values = np.zeros_like(steps)
    for k in range(1, 2100):
        values[:, k] = 0.8 * values[:, k - 1] + steps[:, k]
    values = values[:, 100:]
    errors, independent = np.array([mean_error(one) for one in values]).T
    assert np.mean(errors) == pytest.approx(5.0 / np.sqrt(2000.0), rel=0.05)
    assert np.mean(independent) == pytest.approx(2000.0 / 9.0, rel=0.08)
    assert np.std(values.mean(axis=1) / errors) == pytest.approx(1.0, abs=0.15)
    assert mean_error(np.arange(50.0))[1] < 5.0  # a trend is worth few
    assert np.isnan(mean_error(np.arange(3.0))[0])
    assert mean_error(np.ones(50)) == (0.0, 50.0)


def test_a_window_that_is_too_short_for_an_error_bar_is_named() -> None:
    lines = simulate(shaken(3.0), "simplified", check=False).warnings
    assert [line for line in lines if line.startswith("the steady window holds ")]
    assert not simulate(shaken(60.0), "simplified", check=False).warnings


def test_a_shock_is_measured_by_the_largest_deflection() -> None:
    """A short pulse is a step of the velocity, dv: deflection dv / w, here exp(-zeta atan(1 / zeta)) of it."""
    shock = {"acceleration": 200.0, "duration": 1e-3, "at": 0.1, "compensation": 20.0}
    scene = shaken(22.0, excitation={"shock": shock}, steady_window=[0.0, 30.0])
    found = simulate(scene, "simplified", check=False)
    for value, mass in ((found.undamped_deflection, scene.total_mass), (found.bare_deflection, scene.beam.mass)):
        omega = np.sqrt(scene.beam.stiffness / mass)
        ratio = 0.5 * scene.beam.damping / (mass * omega)
        root = np.sqrt(1.0 - ratio**2)
        largest = 0.4 / np.pi / omega * np.exp(-ratio / root * np.arctan2(root, ratio))
        assert value == pytest.approx(largest, rel=4e-3)  # the compensation's own: 2 / 20 w = 3e-3
    assert found.deflection == found.undamped_deflection
    assert np.isnan(found.rms)


@pytest.mark.parametrize(("kind", "motion"), [("tones", "tones"), ("series", "recorded"), ("shock", "shock")])
def test_a_motion_is_called_what_drives_it(kind: str, motion: str, tmp_path: Path) -> None:
    times = np.arange(0.0, 6.001, 1e-3)
    np.savez(tmp_path / "a.npz", time=times, support_displacement=0.01 * np.sin(34.0 * times))
    excitation = {
        "tones": {"tones": [{"amplitude": 0.01, "frequency": 5.4}, {"amplitude": 0.005, "frequency": 4.1}]},
        "series": {"series": {"file": str(tmp_path / "a.npz")}},
        "shock": {"shock": {"acceleration": 50.0, "duration": 0.05}},
    }[kind]
    scene = standard_bench(excitation=excitation, duration=6.0, ceiling={"height": 0.06}, steady_window=[0.0, 6.0])
    found = simulate(scene, "impact", check=False)
    assert found.motion == motion
    assert np.isnan(found.rms) == (kind == "shock")
    assert np.isnan(found.deflection) == (kind != "shock")


def test_the_command_shows_root_mean_squares_and_writes_the_spectrum(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, spectrum = tmp_path / "scene.yaml", str(tmp_path / "s.csv")
    file.write_text(shaken(30.0, height=0.06).to_yaml())
    arguments = ["simulate", str(file), "--fidelity", "impact", "--rtol", "1e-4"]
    assert main([*arguments, "--json", "--spectrum", spectrum]) == 0
    result = json.loads(capsys.readouterr().out)
    frequency, support, *_ = np.loadtxt(spectrum, delimiter=",", skiprows=1).T
    assert np.sqrt(np.sum(support) * frequency[1]) == pytest.approx(result["support_rms"], rel=0.1)
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert f"{result['rms']:.6g} ± {result['rms_error']:.2g}" in text
    assert "random" in text
    standard = str(Path(__file__).parents[2] / "scenes" / "standard.yaml")
    assert main(["simulate", standard, "--spectrum", str(tmp_path / "t.csv")]) == 2
    assert "--spectrum: given for an excitation of kind harmonic; allowed: tones, rando" in capsys.readouterr().err
    assert main(["simulate", str(file), "--steady", "--spectrum", str(tmp_path / "t.csv")]) == 2
