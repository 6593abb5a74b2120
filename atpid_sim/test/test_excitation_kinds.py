# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tones, random motion, shocks and recorded accelerations of the support, against closed forms of a linear structure.

The closed damper is one mass on spring and dashpot: H(f) = (k + i c w) / (k - m w^2 + i c w) of its displacement over
that of the support; Duhamel's integral of its deflection.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from atpid_sim.engine import columns, drive
from atpid_sim.outcome import NumericalFailure
from atpid_sim.scene import Scene, SceneError, standard_bench
from atpid_sim.scene.density import band_power
from atpid_sim.simulation import signals
from atpid_sim.simulation.excitation import amplitude_at, frequency_at, support_rows
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

CLOSED = {"height": 0.017}
PSD = {"psd": [[2.0, 0.2], [8.0, 0.8], [20.0, 0.1]], "unit": "(m/s^2)^2/Hz"}


def driven(duration: float = 30.0, ceiling: dict[str, float] = CLOSED, **excitation: Any) -> Scene:
    return standard_bench(excitation=excitation, duration=duration, ceiling=ceiling)


def gain(scene: Scene, frequency: Array) -> Any:
    beam, omega = scene.beam, 2.0 * np.pi * frequency
    support = beam.stiffness + 1j * beam.damping * omega
    return support / (support - scene.beam.mass / (1.0 - scene.grain.mass_fraction) * omega**2)


def at(rows: Array, times: Array) -> Array:
    return np.array([drive.support_displacement(rows, float(t)) for t in times])


def test_the_beam_under_several_tones_moves_as_the_sum_of_its_responses() -> None:
    own = standard_bench().natural_frequency_hz
    tones = [(0.004, own, 0.0), (0.002, 3.217, 1.3), (0.0005, 17.9, -2.0)]
    given = [{"amplitude": a, "frequency": "resonance" if f == own else f, "phase": p} for a, f, p in tones]
    scene = driven(tones=given)
    motion = trajectory(scene, 200.0, "simplified")
    late = motion.time > 25.0  # what the start has excited has fallen by 4e-9
    t = motion.time[late]
    waves = [a * np.exp(1j * (2.0 * np.pi * f * t + p)) for a, f, p in tones]
    support = sum(np.imag(wave) for wave in waves)
    beam = sum(np.imag(gain(scene, np.array(f)) * wave) for (_, f, _), wave in zip(tones, waves, strict=True))
    assert np.abs(motion.support[late] - support).max() < 1e-8 * 0.004
    assert np.abs(motion.beam[late] + scene.static_deflection - beam).max() < 1e-6 * np.abs(beam).max()
    assert np.isnan([amplitude_at(scene, 1.0), frequency_at(scene, 1.0)]).all()
    assert len(support_rows(driven(tones=[{"amplitude": 0.0, "frequency": 3.0}]))) == 1


@pytest.mark.parametrize(
    ("psd", "unit", "squares"),
    [
        # white acceleration: S (f2 - f1), and S / (2 pi)^4 (f1^-3 - f2^-3) / 3 of the displacement
        ([[4.0, 0.3], [40.0, 0.3]], "(m/s^2)^2/Hz", (0.3 / (2.0 * np.pi) ** 4 * (4.0**-3 - 40.0**-3) / 3.0, 10.8)),
        ([[4.0, 3e-3], [40.0, 3e-3]], "g^2/Hz", (3e-3 * 9.80665**2 / 1558.545 * (4.0**-3 - 40.0**-3) / 3.0, 10.3864)),
        # S = s / f: s ln(f2 / f1), and s (2 pi)^4 (f2^4 - f1^4) / 4 of the acceleration
        ([[4.0, 2e-8], [40.0, 2e-9]], "m^2/Hz", (8e-8 * np.log(10.0), 8e-8 * 1558.545 * (40.0**4 - 4.0**4) / 4.0)),
    ],
)
def test_a_random_motion_has_the_root_mean_squares_of_its_density(
    psd: list[list[float]], unit: str, squares: tuple[float, float]
) -> None:
    scene = driven(150.0, random={"psd": psd, "unit": unit, "seed": 5})
    density = scene.excitation.random.displacement_psd  # type: ignore[union-attr]
    assert band_power(density, [4.0, 40.0])[0] == pytest.approx(squares[0], rel=1e-5)
    found = signals.root_mean_squares(support_rows(scene), 1.0, 150.0)
    # standard error 1 / (2 sqrt(B T)), with B = (integral of S)^2 / integral of S^2 of 3.1 Hz and 17 Hz at least
    assert found[0] == pytest.approx(np.sqrt(squares[0]), rel=4 * 0.023)
    assert found[1] == pytest.approx(np.sqrt(squares[1]), rel=4 * 0.010)


def test_a_realisation_belongs_to_its_seed_and_begins_at_rest() -> None:
    first, same, other = (support_rows(driven(random={**PSD, "seed": seed})) for seed in (1, 1, 2))
    assert np.array_equal(first, same)
    assert not np.allclose(first[:, columns.C0], other[:, columns.C0])
    assert np.array_equal(support_rows(driven(random=PSD).with_(seed=1)), first)
    assert np.abs(first[0, columns.C0 : columns.C2 + 1]).max() < 1e-6
    assert np.array_equal(first[1:, columns.START], first[:-1, columns.END])
    assert first[-1, columns.END] == 30.0
    # the spline has no jump: each row ends where the next begins
    ends = first[:, columns.END] - first[:, columns.START]
    value = np.sum([first[:, columns.C0 + k] * ends**k for k in range(4)], axis=0)
    assert np.abs(value[:-1] - first[1:, columns.C0]).max() < 1e-15


def test_the_spline_of_a_random_motion_is_within_1e_8() -> None:
    """Every second knot left out makes an error that is 16 times as large."""
    scene = driven(random={**PSD, "seed": 3})
    rows = support_rows(scene)
    times, size = np.arange(3.0, 9.0, 0.00137), np.abs(rows[:, columns.C0]).max()
    knots = np.append(rows[:, columns.START], 30.0)[::2]
    coarse = CubicSpline(knots, at(rows, knots))(times)
    assert np.abs(coarse - at(rows, times)).max() < 16.0 * 1e-8 * size


def test_a_realisation_of_another_density_is_refused() -> None:
    step, lines = 1e-3, 4000
    length = 2 * 60_000
    powers = band_power(((2.0, 1.0), (20.0, 1.0)), [(k - 0.5) / (length * step) for k in range(lines + 1)])
    parts = np.random.default_rng(0).standard_normal((lines, 2)) @ np.array([0.5, -0.5j])
    values = np.fft.irfft(np.sqrt(powers) * parts, length)[:60_000] * length
    signals._require_density(values, 1.0 / step, powers, (length, 2.0, 20.0), "here")
    with pytest.raises(NumericalFailure, match=r"^here: the realisation has 1\.\d+ of the power asked for from "):
        signals._require_density(1.3 * values, 1.0 / step, powers, (length, 2.0, 20.0), "here")


def test_many_seeds_and_short_runs_agree_with_their_density() -> None:
    for seed in range(150):
        support_rows(driven(0.6 + 0.05 * seed, random={**PSD, "seed": seed}))


def test_a_shock_deflects_the_beam_as_duhamel_s_integral_does() -> None:
    peak, pulse, begin, back = -30.0, 0.05, 0.5, 1.2
    shock = {"acceleration": peak, "duration": pulse, "at": begin, "compensation": back}
    scene = driven(4.0, shock=shock)
    motion = trajectory(scene, 500.0, "simplified")
    fine = np.linspace(0.0, 4.0, 400_001)
    s = fine - begin
    acceleration = np.where((s >= 0.0) & (s <= pulse), peak * np.sin(np.pi * s / pulse), 0.0)
    s = s - pulse
    slow = -peak * 4.0 * pulse / (np.pi * back) * np.sin(np.pi * s / back) ** 2
    acceleration += np.where((s > 0.0) & (s <= back), slow, 0.0)
    mass = scene.beam.mass / 0.9
    decay = 0.5 * scene.beam.damping / mass
    damped = np.sqrt(scene.beam.stiffness / mass - decay**2)
    step = fine[1]
    for t in (0.52, 0.6, 0.9, 1.75, 3.9):
        past = fine[fine <= t + 1e-9]
        kernel = np.exp(-decay * (t - past)) * np.sin(damped * (t - past)) / damped
        deflection = -np.trapezoid(acceleration[: len(past)] * kernel, dx=step)
        k = round(500.0 * t)
        found = motion.beam[k] - motion.support[k] + scene.static_deflection
        assert found == pytest.approx(deflection, abs=2e-6 * 0.01)
    travel = peak * pulse * (pulse + back) / np.pi
    assert motion.support[-1] == pytest.approx(travel, rel=1e-12)
    rows = support_rows(scene)
    assert rows[-1, [columns.A0, columns.C1, columns.C2, columns.C3]].tolist() == [0.0] * 4
    edges = rows[1:, columns.START]
    assert at(rows, edges - 1e-12) == pytest.approx(at(rows, edges), abs=1e-11)
    given = {**shock, "acceleration": None, "displacement": travel}
    assert np.allclose(support_rows(driven(4.0, shock=given)), rows, rtol=1e-12)


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_a_recorded_acceleration_is_integrated_without_its_offset(jitter: float, tmp_path: Path) -> None:
    """Of a motion that begins and ends at rest, so that the filter meets no jump of the velocity."""
    times = np.arange(0.0, 24.0005, 1e-3)
    times[1:-1] += 1e-3 * jitter * np.random.default_rng(0).uniform(-1.0, 1.0, len(times) - 2)
    # u = sum of A sin(w t), swelling as sin^2(pi t / 24): tones at w and beside it
    slow = 2.0 * np.pi / 24.0
    waves = [
        (0.5 * part * size, 2.0 * np.pi * f + side * slow)
        for size, f in ((0.01, 5.2), (0.004, 2.3))
        for part, side in ((1.0, 0), (-0.5, 1), (-0.5, -1))
    ]
    displacement = sum(a * np.sin(w * times) for a, w in waves)
    acceleration = sum(-a * w**2 * np.sin(w * times) for a, w in waves)
    np.savez(tmp_path / "a.npz", time=times, a=acceleration + 0.3)
    series = {"file": str(tmp_path / "a.npz"), "acceleration": "a", "high_pass": 0.5}
    rows = support_rows(driven(24.0, series=series))
    grown = np.arange(len(times)) % 7 == 0
    grown &= times > 4.0  # two periods of the high pass
    expected = np.asarray(displacement)[grown]
    found = at(rows, times[grown])
    # the filter leaves 1 / (1 + (0.5 / 2.3)^8) = 1 - 5e-6 of a tone
    assert np.abs(found - expected).max() < 1e-4 * 0.01
    assert at(rows, np.array([0.0]))[0] == 0.0


@pytest.mark.parametrize(
    ("duration", "excitation", "line"),
    [
        (1e4, {"tones": [{"amplitude": 1e-3, "frequency": 50.0}]}, "excitation.tones: given 10000 s of up to 50 Hz"),
        (600.0, {"random": {**PSD, "psd": [[1.0, 1.0], [900.0, 1.0]]}}, "excitation.random: given 600 s of up to 900"),
        (0.4, {"random": PSD}, "excitation.random: given a lowest frequency of 2 Hz and a rise of 0.1 s in a run of"),
        (9.0, {"random": {**PSD, "rise": 5.0}}, "excitation.random: given a lowest frequency of 2 Hz and a rise of 5"),
        (2.0, {"shock": {"acceleration": 9.0, "duration": 0.1, "at": 1.0}}, "excitation.shock: given one that comes"),
    ],
)  # fmt: skip
def test_what_cannot_be_driven_is_one_line(duration: float, excitation: dict[str, Any], line: str) -> None:
    with pytest.raises(SceneError) as caught:
        support_rows(driven(duration, **excitation))
    assert str(caught.value).startswith(line)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("excitation", "line"),
    [
        ({"tones": []}, "excitation.tones: given []; allowed: "),
        ({"tones": [{"amplitude": 1.0, "frequncy": 2.0}]}, "excitation.tones[0].frequncy: unknown key; did you mean f"),
        ({"random": {**PSD, "unit": "g/Hz"}}, "excitation.random.unit: given 'g/Hz'; allowed: 'm^2/Hz', '(m/s^2)^2/Hz"),
        ({"random": {**PSD, "psd": [[2.0, 1.0], [1.0, 1.0]]}}, "excitation.random.psd: given 1.0; allowed: rising fr"),
        ({"random": {**PSD, "psd": [[2.0, 1.0], [3.0, 0.0]]}}, "excitation.random.psd: given 0.0; allowed: densities"),
        ({"shock": {"duration": 0.1}}, "excitation.shock: given neither; allowed: exactly one of acceleration, disp"),
        ({"shock": {"duration": 0.1, "acceleration": 1.0, "form": "saw"}}, "excitation.shock.form: given 'saw'; allow"),
        ({"series": {"file": __file__, "acceleration": "a"}}, "excitation.series.file: given "),
    ],
)  # fmt: skip
def test_what_cannot_be_a_scene_is_one_line(excitation: dict[str, Any], line: str) -> None:
    with pytest.raises(SceneError) as caught:
        driven(**excitation)
    assert str(caught.value).startswith(f"standard bench: {line}")
    assert "\n" not in str(caught.value)


def test_an_acceleration_needs_its_high_pass_and_a_file_of_some_periods_of_it(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez(file, time=np.arange(10.0), a=np.zeros(10))
    series = {"file": str(file), "acceleration": "a"}
    with pytest.raises(SceneError, match=r"excitation\.series: given one of acceleration and high_pass; allowed: both"):
        driven(series=series)
    with pytest.raises(SceneError, match=r"excitation\.series: given displacement or offset beside acceleration"):
        driven(series={**series, "high_pass": 1.0, "offset": 0.0})
    with pytest.raises(SceneError, match=r"excitation\.series\.high_pass: given 0\.1; allowed: at least 0\.444 Hz"):
        support_rows(driven(5.0, series={**series, "high_pass": 0.1}))


@pytest.mark.parametrize(
    ("excitation", "line"),
    [
        ({"tones": [{"amplitude": 0.1, "frequency": 5.0}] * 3}, "excitation, amplitude: 0.3 m is unusual"),
        ({"tones": [{"amplitude": 0.1, "frequency": 500.0}]}, "excitation.tones, frequency over the resonance: 91.41"),
        ({"random": {**PSD, "unit": "m^2/Hz"}}, "excitation, amplitude: 3."),
        ({"random": {**PSD, "rise": 28.0}}, "steady_window, its begin over the rise of the random motion: 0.9375 is"),
        ({"shock": {"acceleration": 100.0, "duration": 0.02}}, "excitation.shock, displacement in the end: 1.177 m"),
    ],
)  # fmt: skip
def test_an_unusual_drive_is_named(excitation: dict[str, Any], line: str) -> None:
    warnings = driven(**excitation).warnings()
    assert [warning for warning in warnings if warning.startswith(line)], warnings
