# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frequency response, spectra, decrement and orders against closed forms, and what they say of results in doubt."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_signals import RATE, noise, tone
from recorded import block
from scipy.signal import csd, get_window, lfilter

from atpid_control.analysis import AnalysisError, Signals, analyse, free_decay, frequency_response, spectrum
from atpid_control.analysis.decrement import find_decay
from atpid_control.analysis.spectra import averaged
from atpid_control.cli import main
from atpid_control.runs.metadata import new_run
from atpid_control.runs.writer import BagWriter
from atpid_sim.scene import standard_bench
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags/thesis_4_3_short"


# spectra


def test_a_tone_at_a_line_has_its_amplitude() -> None:
    found = spectrum(tone(5.0, 0.03, 20.0), RATE, resolution=0.5)
    assert found.amplitude[10] == pytest.approx(0.03, rel=1e-9)
    assert found.frequency[10] == 5.0


def test_white_noise_has_the_density_of_its_variance() -> None:
    """One-sided: 2 sigma^2 / rate, with the relative standard deviation 1/sqrt(averages)."""
    found = spectrum(noise(200_000, 1, 0.01), RATE, resolution=2.0)
    ratio = found.density[2:-2] / (2.0 * 0.01**2 / RATE)
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert ratio.std() == pytest.approx(1.0 / math.sqrt(found.averages), rel=0.15)
    assert found.rms == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize("window", ["hann", "boxcar", "flattop"])
@pytest.mark.parametrize("length", [586, 587])
def test_spectra_are_those_of_scipy(window: str, length: int) -> None:
    """Of signals with a mean, which is taken from each segment; a tone both have tells the sign of the phase."""
    one, other = (0.3 + noise(5003, seed, 1.0) + tone(20.0, 2.0, 5.003, seed) for seed in (1, 2))
    found = averaged(one, other, RATE, RATE / length, window)
    shape, overlap = get_window(window, length), 0 if window == "boxcar" else length // 2
    for made, (x, y) in zip((found.first, found.cross), ((one, one), (one, other)), strict=True):
        frequency, density = csd(x, y, RATE, window, length, overlap)
        np.testing.assert_allclose(made, density, rtol=1e-9, atol=1e-12 * np.abs(density).max())
        np.testing.assert_allclose(found.frequency, frequency, rtol=1e-12)
    assert found.enbw == pytest.approx(RATE * np.sum(shape**2) / np.sum(shape) ** 2, rel=1e-12)


def test_nothing_is_computed_over_a_gap() -> None:
    """A tone whose phase jumps in a gap keeps its line; joined it would be spread."""
    values = np.concatenate([tone(5.0, 1.0, 10.0), np.full(333, np.nan), tone(5.0, 1.0, 10.0, 2.5)])
    found = spectrum(values, RATE, resolution=0.5)
    whole = spectrum(tone(5.0, 1.0, 10.0), RATE, resolution=0.5)
    np.testing.assert_allclose(found.density, whole.density, rtol=1e-6, atol=1e-15)


def test_too_short_for_the_resolution() -> None:
    with pytest.raises(AnalysisError, match=r"resolution 0.01 Hz needs 100 s without a gap, the record has 20 s; give"):
        spectrum(tone(5.0, 1.0, 20.0), RATE, resolution=0.01)


# frequency response


def multisine(period: float, repeats: int, rate: float, band: tuple[float, float], seed: int = 3) -> Array:
    """Return a periodic signal of random phases with every line of 1/period within the band [Hz]."""
    count = round(period * rate)
    lines = np.zeros(count // 2 + 1, dtype=complex)
    inside = slice(math.ceil(band[0] * period), math.floor(band[1] * period) + 1)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, len(lines[inside]))
    lines[inside] = np.exp(1j * phases)
    one = np.fft.irfft(lines, count)
    return np.asarray(np.tile(one / np.abs(one).max(), repeats))


@pytest.mark.slow
def test_the_beam_has_the_response_of_one_mass(tmp_path: Path) -> None:
    """Simulated with the damper closed: (k + i omega c) / (k - M omega^2 + i omega c), as a driven base gives."""
    rate, period = 200.0, 8.0
    support = 0.001 * multisine(period, 10, rate, (1.0, 12.0))
    series = tmp_path / "support.csv"
    table = np.column_stack([np.arange(len(support)) / rate, support])
    np.savetxt(series, table, fmt="%.15g", delimiter=",", header="time,support_displacement", comments="")
    scene = standard_bench(
        excitation={"series": {"file": str(series)}}, ceiling={"height": 0.017}, duration=len(support) / rate - 0.1,
        steady_window=[70.0, 79.0], tolerance=1e-7,
    )  # fmt: skip
    motion = trajectory(scene, rate, "simplified")
    kept = slice(round(3 * period * rate), round(9 * period * rate))  # after the transient, whole periods
    found = frequency_response(Signals(rate, support[kept], motion.beam[kept]), 1.0 / period, "boxcar")
    omega = 2.0 * math.pi * found.frequency[found.excited]
    stiffness = scene.beam.stiffness + 1j * omega * scene.beam.damping
    exact = stiffness / (stiffness - scene.total_mass * omega**2)
    np.testing.assert_allclose(found.h1[found.excited], exact, rtol=2e-3)
    np.testing.assert_allclose(found.h2[found.excited], exact, rtol=2e-3)
    assert found.trusted[found.excited].all()
    assert found.frequency[found.strongest] == pytest.approx(scene.natural_frequency_hz, abs=1.0 / period)


@pytest.mark.parametrize("at", ["output", "input"])
def test_h1_is_unbiased_under_output_noise_and_h2_under_input_noise(at: str) -> None:
    """Of a gain of 2: the other one is off by the noise's share of the power, which both make known."""
    clean = noise(400_000, 1)
    added = noise(400_000, 2, 0.5)
    given, answer = (clean, 2.0 * clean + 2.0 * added) if at == "output" else (clean + added, 2.0 * clean)
    found = frequency_response(Signals(RATE, given, answer), resolution=5.0)
    inner = slice(2, -2)
    h1, h2 = found.h1[inner].mean(), found.h2[inner].mean()
    unbiased, biased = (h1, h2) if at == "output" else (h2, h1)
    expected = 2.0 * 1.25 if at == "output" else 2.0 / 1.25
    assert abs(unbiased - 2.0) < 0.005
    assert biased.real == pytest.approx(expected, rel=0.005)
    assert found.coherence[inner].mean() == pytest.approx(0.8, abs=0.005)


def test_the_error_bars_of_h1_are_what_it_scatters_by() -> None:
    clean = noise(200_000, 4)
    found = frequency_response(Signals(RATE, clean, 2.0 * clean + noise(200_000, 5)), resolution=0.5)
    inner = slice(2, -2)
    scatter = (np.abs(found.h1[inner]) / 2.0 - 1.0) / found.relative_std[inner]
    assert scatter.std() == pytest.approx(1.0, abs=0.15)
    assert abs(scatter.mean()) < 0.2


def test_low_coherence_and_few_averages_are_named() -> None:
    clean = noise(20_000, 6)
    found = frequency_response(Signals(RATE, clean, clean + noise(20_000, 7, 3.0)), resolution=1.0)
    assert any("coherence below 0.8" in line for line in found.doubts)
    assert not found.trusted.all()
    one = frequency_response(Signals(RATE, clean, clean), resolution=RATE / 20_000)
    assert one.averages == 1.0
    assert any("coherence and error bars mean nothing" in line for line in one.doubts)
    assert not one.trusted.any()
    assert np.isnan(one.relative_std).all()


def test_lines_too_far_apart_for_a_peak_are_named() -> None:
    """A resonance of 0.25 Hz width at lines 1 Hz apart: too low by half, and the two estimators differ."""
    pole = np.exp((-0.8 + 2j * math.pi * 5.5) / RATE)
    given = noise(400_000, 8)
    answer = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], given)
    coarse, fine = (frequency_response(Signals(RATE, given, answer), step) for step in (1.0, 0.05))
    assert any("H1 and H2 differ by" in line for line in coarse.doubts)
    assert not any("H1 and H2 differ by" in line for line in fine.doubts)
    assert abs(coarse.h1[coarse.strongest]) < 0.8 * abs(fine.h1[fine.strongest])


def test_no_excitation() -> None:
    with pytest.raises(AnalysisError, match="no excitation: support_displacement is constant"):
        frequency_response(Signals(RATE, np.zeros(5000), noise(5000, 1)))


# decrement


def decaying(duration: float = 3.0, ratio: float = 0.03, frequency: float = 5.5, offset: float = 0.2) -> Array:
    omega = 2.0 * math.pi * frequency
    time = np.arange(round(duration * RATE)) / RATE
    fall = ratio * omega / math.sqrt(1.0 - ratio**2)  # of the damped frequency
    return np.asarray(offset + 0.1 * np.exp(-fall * time) * np.cos(omega * time + 0.3))


@pytest.mark.parametrize("ratio", [0.001, 0.03, 0.3])
def test_an_exact_decay_gives_its_frequency_and_damping(ratio: float) -> None:
    found = free_decay(decaying(ratio=ratio), RATE, start=2.0)
    assert found.frequency == pytest.approx(5.5, rel=1e-8)
    assert found.damping_ratio == pytest.approx(ratio, rel=1e-7)
    assert found.log_decrement == pytest.approx(2.0 * math.pi * ratio / math.sqrt(1.0 - ratio**2), rel=1e-7)
    assert found.begin == 2.0
    if ratio == 0.03:
        np.testing.assert_allclose(found.ratios, math.exp(found.log_decrement), rtol=1e-3)
        assert found.doubts == ()


def test_the_error_bars_of_a_decay_cover_the_truth() -> None:
    off = []
    for seed in range(60):
        found = free_decay(decaying(duration=2.0) + noise(2000, seed, 1e-3), RATE)
        off.append(
            [(found.frequency - 5.5) / found.frequency_std, (found.damping_ratio - 0.03) / found.damping_ratio_std]
        )
    deviations = np.std(off, axis=0)
    assert np.all((deviations > 0.75) & (deviations < 1.3)), deviations
    assert np.all(np.abs(np.mean(off, axis=0)) < 0.5)


def test_a_decay_that_is_short_or_not_exponential_is_doubted() -> None:
    short = free_decay(decaying(duration=0.5), RATE)
    assert any("the decay is short: 2" in line for line in short.doubts)
    time = np.arange(3000) / RATE
    dry = np.maximum(0.0, 0.1 - 0.04 * time) * np.cos(2.0 * math.pi * 5.5 * time)  # falls in a straight line: friction
    assert any("not an exponential decay" in line for line in free_decay(dry, RATE).doubts)
    with pytest.raises(AnalysisError, match=r"two periods|1.* periods"):
        free_decay(decaying(duration=0.25), RATE)


@pytest.mark.slow
def test_a_simulated_release_has_the_beams_own_damping() -> None:
    scene = standard_bench(
        excitation={"free": {"deflection": 0.2}}, ceiling={"height": 0.017}, duration=6.0, steady_window=[5.0, 6.0]
    )
    motion = trajectory(scene, RATE, "simplified")
    begin, end = find_decay(motion.support, motion.beam, RATE) or (0, 0)
    found = free_decay(motion.beam[begin:end], RATE)
    natural = math.sqrt(scene.beam.stiffness / scene.total_mass)
    assert found.damping_ratio == pytest.approx(0.5 * scene.beam.damping / (scene.total_mass * natural), rel=1e-4)
    assert (begin, end) == (0, len(motion.beam))


def test_a_decay_after_the_excitation_is_found() -> None:
    support = np.concatenate([tone(5.5, 0.02, 4.0), np.zeros(3000)])
    beam = np.concatenate([tone(5.5, 0.1, 4.0), decaying(offset=0.0)])
    begin, end = find_decay(support, beam, RATE) or (0, 0)
    assert 4000 <= begin < 4200
    assert end == 7000
    assert find_decay(tone(5.5, 0.02, 7.0), tone(5.5, 0.1, 7.0), RATE) is None


# the command


def written(folder: Path, support: Array, beam: Array, channels: tuple[str, str] | None = None) -> Path:
    """Write a bag of two channels."""
    writer = BagWriter(folder, new_run(run_id="signals", commit="none"))
    writer.add_topic("/sensors/laser", "atpid_interfaces/msg/SampleBlock")
    more: dict[str, Any] = {} if channels is None else {"channels": list(channels)}
    data = np.column_stack([support, beam])
    for first in range(0, len(data), 50):
        at = round(first / RATE * 1e9)
        writer.write("/sensors/laser", block(first, data[first : first + 50], RATE, **more), at, at)
    writer.close({"finished": "yes"})
    return folder


@pytest.mark.slow
def test_the_command_writes_numbers_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bag", "analyse", str(BAG), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "a tone: the response holds there" in printed
    found = json.loads((tmp_path / "analysis.json").read_text())
    assert found["orders"]["frequency"] == pytest.approx(5.47, abs=0.01)
    assert found["orders"]["excitation"] == pytest.approx(0.025, rel=1e-3)
    assert found["orders"]["amplitude"][0] == pytest.approx(0.109, abs=0.003)
    assert "at rest" in found["skipped"]["decrement"]
    assert (tmp_path / "analysis.png").stat().st_size > 20_000


def test_a_decay_in_a_bag_has_no_excitation_and_is_fitted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = written(tmp_path / "bag", noise(3000, 1, 2e-5), decaying() + noise(3000, 2, 2e-5))
    assert main(["bag", "analyse", str(bag), "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["decrement"]["damping_ratio"] == pytest.approx(0.03, rel=5e-3)
    assert abs(found["decrement"]["damping_ratio"] - 0.03) < 4.0 * found["decrement"]["damping_ratio_std"]
    assert found["skipped"]["frequency_response"] == "no excitation: support_displacement is at rest"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{tmp}"], "not a bag, there is no .mcap or .db3 file"),
        (
            ["{tmp}/other"],
            "no samples of support_displacement and beam_displacement together; channels in it: a, b",
        ),
        (["{tmp}/still"], "beam_displacement is constant: nothing to analyse"),
        (["{tmp}/other", "--input", "a", "--output", "b", "--resolution", "0.1"], "needs 10 s without a gap"),
        (["{tmp}/other", "--input", "a", "--output", "b", "--from", "9"], "allowed: rising times from 0 to 3 s"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    written(tmp_path / "other", noise(3000, 1), noise(3000, 2), ("a", "b"))
    written(tmp_path / "still", tone(5.0, 0.1, 1.0), np.zeros(1000))
    given = [text.format(tmp=tmp_path) for text in arguments]
    assert main(["bag", "analyse", *given, "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert (len(printed.err.splitlines()), printed.out) == (1, "")


@pytest.mark.slow
def test_a_fault_within_the_part_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stuck = ["bag", "analyse", str(ROOT / "bags/laser_stuck")]
    assert main([*stuck, "--out", str(tmp_path / "all")]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "trusted: fault" in line]
    assert line.startswith("not to be trusted: fault at 2.699 s, identifier_node: support_displacement: frozen at ")
    assert json.loads((tmp_path / "all/analysis.json").read_text())["faults"] == [line.partition(": ")[2]]
    assert main([*stuck, "--out", str(tmp_path / "part"), "--from", "4"]) == 0
    assert "trusted: fault" not in capsys.readouterr().out


def test_another_analysis_replaces_the_first_but_beside_other_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = written(tmp_path / "bag", tone(5.0, 0.01, 4.0), tone(5.0, 0.03, 4.0, 1.0))
    command = ["bag", "analyse", str(bag), "--out", str(tmp_path / "out")]
    assert main(command) == 0
    assert main(command) == 0
    (tmp_path / "out/mine").write_text("")
    assert main(command) == 2
    assert "exists already; give another --out" in capsys.readouterr().err
    assert main([*command, "--force"]) == 0


def test_signals_of_another_unit_and_without_the_excitation() -> None:
    found = analyse(Signals(RATE, np.full(4000, np.nan), tone(5.0, 1.0, 4.0), ("m", "m/s^2")))
    assert found.response is None
    assert "no excitation" in found.skipped["orders"]
    json.dumps(found.to_json(), allow_nan=False)
