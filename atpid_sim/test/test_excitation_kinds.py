# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tones, sweeps, random motion, shocks, measured series: against closed forms of a linear structure; what is measured.

The closed damper is one mass on spring and dashpot: H(f) = (k + i c w) / (k - m w^2 + i c w) of its displacement over
that of the support; Duhamel's integral of its deflection.
"""

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from sim_program import main
from sim_refusals import command_refused, has_parts, refused

from atpid_sim.engine import columns, drive
from atpid_sim.scene import Scene, SceneError, SeriesExcitation, scene_from_mapping, standard_bench
from atpid_sim.scene.drives import band_power
from atpid_sim.scene.series import read_series
from atpid_sim.scene.yaml12 import read_yaml
from atpid_sim.simulation import signals
from atpid_sim.simulation.excitation import amplitude_at, frequency_at, support_rows
from atpid_sim.simulation.integration import drive_table, undamped_amplitude
from atpid_sim.simulation.simulate import simulate, trajectory
from atpid_sim.simulation.unrepeated import mean_error, vibration, write_spectrum
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
    ("excitation", "parts"),
    [
        ({"tones": [{"amplitude": 0.1, "frequency": 5.0}] * 3}, "excitation, amplitude: 0.3 m"),
        ({"random": {**PSD, "unit": "m^2/Hz"}}, "excitation, amplitude: 3."),
        ({"random": {**PSD, "rise": 28.0}}, "steady_window, rise 0.9375"),
        ({"shock": {"acceleration": 100.0, "duration": 0.02}}, "excitation.shock, displacement 1.177 m"),
    ],
)
def test_an_unusual_drive_is_named(excitation: dict[str, Any], parts: str) -> None:
    lines = driven(**excitation).warnings()
    has_parts(next(line for line in lines if line.startswith(parts.split()[0])), tuple(parts.split()))


@pytest.mark.parametrize(
    ("duration", "excitation", "parts"),
    [
        (1e4, {"tones": [{"amplitude": 1e-3, "frequency": 50.0}]}, "excitation.tones 10000 s 50 Hz"),
        (600.0, {"random": {**PSD, "psd": [[1.0, 1.0], [900.0, 1.0]]}}, "excitation.random 600 s 900"),
        (0.4, {"random": PSD}, "excitation.random 2 Hz 0.1 s"),
        (9.0, {"random": {**PSD, "rise": 5.0}}, "excitation.random 2 Hz 5"),
        (2.0, {"shock": {"acceleration": 9.0, "duration": 0.1, "at": 1.0}}, "excitation.shock"),
        (9.0, {"tones": [{"amplitude": 1.0, "frequncy": 2.0}]}, "excitation.tones[0].frequncy f"),
        (9.0, {"random": {**PSD, "unit": "g/Hz"}}, "excitation.random.unit 'g/Hz' 'm^2/Hz' (m/s^2)^2/Hz"),
        (9.0, {"random": {**PSD, "psd": [[2.0, 1.0], [1.0, 1.0]]}}, "excitation.random.psd 1.0 rising"),
        (9.0, {"shock": {"duration": 0.1}}, "excitation.shock acceleration disp"),
        (
            1000.0,
            {"amplitude": 0.01, "frequency": [[0.0, 50.0], [1000.0, 51.0]]},
            "excitation.frequency 50 1000 s 25000",
        ),
        (9.0, {"amplitude": 0.01, "frequency": [[0.0, 5.0], [0.0, 6.0]]}, "excitation.frequency rising"),
        (9.0, {"amplitude": 0.01, "frequency": [[0.0, -1.0]]}, "excitation.frequency 1e-06"),
        (9.0, {"amplitude": 0.01, "frequency": [[0.0, "fast"]]}, "excitation.frequency number"),
    ],
)
def test_what_cannot_be_driven_is_one_line(duration: float, excitation: dict[str, Any], parts: str) -> None:
    with refused(SceneError, *parts.split()):
        support_rows(driven(duration, **excitation))


def test_an_acceleration_needs_its_high_pass_and_a_file_of_some_periods_of_it(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez(file, time=np.arange(10.0), a=np.zeros(10))
    series = {"file": str(file), "acceleration": "a"}
    with refused(SceneError, "excitation.series", "acceleration", "high_pass"):
        driven(series=series)
    with refused(SceneError, "excitation.series", "displacement", "offset", "acceleration"):
        driven(series={**series, "high_pass": 1.0, "offset": 0.0})
    with refused(SceneError, "excitation.series.high_pass", "0.1", "0.444"):
        support_rows(driven(5.0, series={**series, "high_pass": 0.1}))


POINTS = [[2.0, 5.2], [4.0, 5.6], [5.0, 5.6], [5.01, 5.3]]


def moving(**changes: object) -> Scene:
    """Return the standard bench with a frequency that rises, stands and falls quickly, under a growing amplitude."""
    excitation = {"amplitude": [[0.0, 0.0], [3.0, 0.01]], "frequency": POINTS}
    return standard_bench(**({"excitation": excitation, "duration": 8.0} | changes))


def test_the_support_is_the_sine_of_the_integrated_frequency() -> None:
    rows = support_rows(moving())
    times = np.arange(0.0, 8.0, 0.00137)
    fine = np.linspace(0.0, 8.0, 800_001)
    frequency = np.interp(fine, [t for t, _ in POINTS], [f for _, f in POINTS])
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * np.diff(fine))])
    amplitude = np.interp(times, [0.0, 3.0], [0.0, 0.01])
    expected = amplitude * np.sin(2.0 * math.pi * np.interp(times, fine, turns))
    # 2.5e-9 by the spline, 1e-8 by the integral beside the kinks
    assert np.abs(at(rows, times) - expected).max() < 5e-8 * 0.01 + 2e-7 * 0.01
    scene = moving()
    assert [frequency_at(scene, t) for t in (0.0, 3.0, 4.5, 8.0)] == pytest.approx([5.2, 5.4, 5.6, 5.3])
    assert scene_from_mapping(read_yaml(scene.to_yaml(), "again")) == scene


def swept(first: float, last: float, length: float, duration: float) -> Scene:
    return driven(duration, sweep={"amplitude": 1.0, "from": first, "to": last, "duration": length})


@pytest.mark.parametrize(
    ("first", "last", "length", "duration"),
    [
        (3.0, 8.0, 40.0, 40.0),
        (4.0, 7.0, 5.0, 9.0),
        (0.01, 1000.0, 1.0, 1.0),
        (1000.0, 1e-6, 0.5, 0.5),
        (5.0, 5.0, 3.0, 3.0),
    ],
)
def test_a_sweep_is_within_its_error_everywhere(first: float, last: float, length: float, duration: float) -> None:
    rows = support_rows(swept(first, last, length, duration))
    assert rows[0, columns.START] == 0.0
    assert rows[-1, columns.END] == pytest.approx(duration, rel=1e-15)
    assert np.array_equal(rows[1:, columns.START], rows[:-1, columns.END])
    t = np.random.default_rng(1).uniform(0.0, duration, 2000)
    turning = np.minimum(t, length)
    turns = first * turning + 0.5 * (last - first) / length * turning**2 + last * np.maximum(0.0, t - length)
    assert at(rows, t) == pytest.approx(np.sin(2.0 * np.pi * (turns % 1.0)), abs=2.6e-9)


TIMES = np.arange(2001) * 1e-3
VALUES = 0.01 * np.sin(2.0 * np.pi * 5.0 * TIMES)
ROWS = "".join(f"{t!r},{u!r}\n" for t, u in zip(TIMES.tolist(), VALUES.tolist(), strict=True))
HEADER = "time,support_displacement\n"


def scene_of(file: Path, **series: Any) -> Scene:
    return driven(2.0, series={"file": str(file), **series})


def read(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    assert isinstance(scene.excitation, SeriesExcitation)
    return read_series(scene.excitation.series, scene.duration)


def npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("plain.csv", HEADER + ROWS),
        ("bom.csv", "\ufeff" + HEADER + ROWS),
        ("quoted.csv", '"time", "support_displacement"\r\n' + ROWS.replace("\n", "\r\n")),
        ("savetxt.csv", "# " + HEADER + ROWS),
        ("note.csv", "note," + HEADER + "".join(f"ok,{line}\n" for line in ROWS.splitlines())),
        ("arrays.npz", npz(time=TIMES, support_displacement=VALUES, note=np.array("ok"))),
    ],
)
def test_a_series_is_read(name: str, content: str | bytes, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    times, values = read(scene_of(file))
    assert np.array_equal(times, TIMES)
    assert np.array_equal(values, VALUES)


GOOD = npz(time=TIMES, support_displacement=VALUES)


@pytest.mark.parametrize(
    ("name", "content", "parts"),
    [
        ("torn.npz", GOOD[:2000], "NPZ"),
        ("unequal.npz", npz(time=TIMES, support_displacement=VALUES[:-3]), "2001 1998"),
        ("text.npz", npz(time=TIMES, support_displacement=VALUES.astype(str)), "'support_displacement'"),
        ("other.npz", npz(t=TIMES), "'time' t excitation.series"),
        ("ragged.csv", HEADER + ROWS + "6.0\n", ":2003: 1 columns 2"),
        ("header.csv", HEADER, "0 samples 4"),
        ("utf16.csv", (HEADER + ROWS).encode("utf-16"), "UTF-8"),
        ("words.csv", HEADER + ROWS + "6.0,none\n", ":2003: 'support_displacement' 'none' number"),
        ("quote.csv", HEADER + ROWS + '6.0,"3\n', ":2003: CSV"),
        ("twice.csv", "time," + HEADER + "0,0,0\n", "two 'time'"),
        ("line.csv", '"a\nb",c\n1,2\n', "column 'time' a\\nb, c"),
        ("gap.csv", HEADER + ROWS + "6.0,nan\n", "2002 'support_displacement' nan finite"),
        ("back.csv", HEADER + ROWS + "1.0,0\n", "1 s 2 s 2002"),
        ("short.csv", HEADER + ROWS[: ROWS.index("1.5,")], "1.499 s 2 s"),
    ],
)
def test_what_is_no_series_is_one_line_of_its_file(name: str, content: str | bytes, parts: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with refused(SceneError, name, *parts.split()):
        support_rows(scene_of(file))


@pytest.mark.parametrize(("resting", "series"), [(0.0, {}), (0.3, {}), (0.3, {"offset": 0.3}), (-0.02, {})])
def test_runs_begin_at_rest_wherever_the_laser_reads(resting: float, series: dict[str, float], tmp_path: Path) -> None:
    file = tmp_path / "laser.npz"
    np.savez(file, time=TIMES + 100.0, support_displacement=VALUES + resting)
    scene = scene_of(file, **series)
    rows = support_rows(scene)
    assert at(rows, np.zeros(1)) == pytest.approx(0.0, abs=1e-15)
    middle = 0.5 * (rows[:-1, columns.START] + rows[:-1, columns.END])
    assert np.allclose(at(rows, middle[::97]), 0.01 * np.sin(2.0 * np.pi * 5.0 * middle[::97]), rtol=0.0, atol=1e-10)


def test_an_offset_given_is_the_one_taken(tmp_path: Path) -> None:
    file = tmp_path / "laser.npz"
    np.savez(file, time=TIMES, support_displacement=VALUES + 0.3)
    assert [read(scene_of(file, offset=given))[1][0] for given in (0.0, 0.25)] == pytest.approx([0.3, 0.05])
    with refused(SceneError, "excitation.series.offset", "1e+300", "-1000", "1000"):
        scene_of(file, offset=1e300)


def test_a_series_of_a_tone_moves_the_beam_as_the_tone_does(tmp_path: Path) -> None:
    file = tmp_path / "tone.npz"
    np.savez(file, time=TIMES, support_displacement=VALUES + 0.3)
    tone = driven(2.0, amplitude=0.01, frequency=5.0)
    both = [scene.with_(steady_window=[0.0, 2.0]) for scene in (scene_of(file), tone)]
    measured, exact = (undamped_amplitude(scene, drive_table(scene, (0.0, 2.0))) for scene in both)
    assert measured == pytest.approx(exact, rel=1e-6)


DENSITIES = ((2.0, 0.2), (8.0, 0.8), (20.0, 0.1))
RANDOM = {"random": {"psd": [list(point) for point in DENSITIES], "unit": "(m/s^2)^2/Hz"}}


def shaken(seconds: float = 60.0, height: float = 0.017, **changes: Any) -> Scene:
    """Return the standard bench under a random motion, measured for so long after 8 s, in which a start has faded."""
    given = {"excitation": RANDOM, "duration": 8.0 + seconds, "steady_window": [8.0, 8.0 + seconds], "tolerance": 1e-3}
    return standard_bench(**(given | {"ceiling": {"height": height}} | changes))


def density(scene: Scene, frequency: Array, mass: float) -> Array:
    """|H|^2 S of the beam's displacement [m^2/Hz], from the acceleration's points."""
    omega, beam = 2.0 * np.pi * frequency, scene.beam
    asked = np.exp(np.interp(np.log(frequency), *np.log(np.array(DENSITIES).T)))
    asked = np.where((frequency >= 2.0) & (frequency <= 20.0), asked, 0.0) / omega**4
    support = beam.stiffness + 1j * beam.damping * omega
    return np.asarray(asked * np.abs(support / (support - mass * omega**2)) ** 2)


def exact_rms(scene: Scene, mass: float) -> float:
    frequency = np.geomspace(2.0, 20.0, 100_001)
    return float(np.sqrt(np.trapezoid(density(scene, frequency, mass), frequency)))


def test_the_closed_damper_has_the_closed_form_s_root_mean_square_within_its_error() -> None:
    off = []
    for seed in range(6):
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
    assert [line for line in lines if "window" in line]
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
    assert simulate(scene.with_(height=0.06), "impact", check=False).motion == "shock"


def test_the_command_shows_squares_and_writes_the_spectrum(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, spectrum = tmp_path / "scene.yaml", str(tmp_path / "s.csv")
    file.write_text(shaken(30.0, height=0.06).to_yaml())
    arguments = ["simulate", str(file), "--fidelity", "impact", "--rtol", "1e-4"]
    assert main([*arguments, "--json", "--spectrum", spectrum]) == 0
    result = json.loads(capsys.readouterr().out)
    frequency, support, *_ = np.loadtxt(spectrum, delimiter=",", skiprows=1).T
    assert np.sqrt(np.sum(support) * frequency[1]) == pytest.approx(result["support_rms"], rel=0.1)
    assert result["motion"] == "random"
    standard = str(Path(__file__).parents[2] / "scenes" / "standard.yaml")
    other = ["--spectrum", str(tmp_path / "t.csv")]
    command_refused(capsys, ["simulate", standard, *other], 2, "--spectrum", "harmonic", "tones", "random")
    command_refused(capsys, ["simulate", str(file), "--steady", *other], 2)
