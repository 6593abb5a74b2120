# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Spectra, frequency response, decrement, orders and integration against closed forms, and results that are doubted."""

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands_run import answered, printed, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from made_signals import RATE, noise, tone
from recorded import block
from scipy.signal import chirp, csd, get_window, lfilter

from atpid_control.analysis import AnalysisError, Signals, analyse, free_decay, frequency_response, orders, spectrum
from atpid_control.analysis.decrement import find_decay
from atpid_control.analysis.orders import steady_part, tone_of
from atpid_control.analysis.signals import displacement_of, integrated
from atpid_control.analysis.spectra import averaged
from atpid_control.runs.metadata import new_run
from atpid_control.runs.writer import BagWriter
from atpid_sim.scene import standard_bench
from atpid_sim.simulation.simulate import trajectory
from atpid_sim.system import Array

ROOT = Path(__file__).resolve().parents[2]
TAU = 2.0 * math.pi
Capture = pytest.CaptureFixture[str]


def doubted(found: Any, word: str) -> bool:
    """Return whether a result is doubted in a line that has a word."""
    return any(re.search(rf"\b{word}\b", line) for line in found.doubts)


# spectra


def test_a_tone_at_a_line_has_its_amplitude_also_beside_a_gap() -> None:
    """A tone whose phase jumps in a gap keeps its line; joined it would be spread."""
    found = spectrum(tone(5.0, 0.03, 20.0), RATE, resolution=0.5)
    assert found.amplitude[10] == pytest.approx(0.03, rel=1e-9)
    assert found.frequency[10] == 5.0
    white = spectrum(noise(200_000, 1, 0.01), RATE, resolution=2.0)
    assert white.density[2:-2].std() / white.density.mean() == pytest.approx(1.0 / math.sqrt(white.averages), rel=0.15)
    assert white.rms == pytest.approx(0.01, rel=0.01)
    gap = np.concatenate([tone(5.0, 0.03, 10.0), np.full(333, np.nan), tone(5.0, 0.03, 10.0, 2.5)])
    np.testing.assert_allclose(spectrum(gap, RATE, resolution=0.5).density, found.density, rtol=1e-6, atol=1e-15)
    with pytest.raises(AnalysisError, match=r"0\.01 Hz .*100 s .*20 s"):
        spectrum(tone(5.0, 1.0, 20.0), RATE, resolution=0.01)


@pytest.mark.parametrize("window", ["hann", "boxcar", "flattop"])
@pytest.mark.parametrize("length", [586, 587])
def test_spectra_are_those_of_scipy(window: str, length: int) -> None:
    """Of signals with a mean, which is taken from each segment; a tone both have shows the sign of the phase."""
    one, other = (0.3 + noise(5003, seed, 1.0) + tone(20.0, 2.0, 5.003, seed) for seed in (1, 2))
    found = averaged(one, other, RATE, RATE / length, window)
    shape, overlap = get_window(window, length), 0 if window == "boxcar" else length // 2
    for made, (x, y) in zip((found.first, found.cross), ((one, one), (one, other)), strict=True):
        frequency, density = csd(x, y, RATE, window, length, overlap)
        np.testing.assert_allclose(made, density, rtol=1e-9, atol=1e-12 * np.abs(density).max())
        np.testing.assert_allclose(found.frequency, frequency, rtol=1e-12)
    assert found.enbw == pytest.approx(RATE * np.sum(shape**2) / np.sum(shape) ** 2, rel=1e-12)


# frequency response, of one mass on a driven base

NATURAL, DAMPING, SLOW = 5.0, 0.03, 200.0


def exact(frequency: Array) -> Array:
    """Return (1 + 2 i zeta r) / (1 - r^2 + 2 i zeta r), r the frequency ratio."""
    loss = 2j * DAMPING * frequency / NATURAL
    return np.asarray((1.0 + loss) / (1.0 - (frequency / NATURAL) ** 2 + loss))


def answer(support: Array) -> Array:
    """Return the periodic response to a support (n,) that is repeated for ever: exact, without a transient."""
    lines = np.fft.rfft(support) * exact(np.asarray(np.fft.rfftfreq(len(support), 1.0 / SLOW), dtype=np.float64))
    return np.asarray(np.fft.irfft(lines, len(support)))


@pytest.mark.parametrize("at", ["output", "input"])
def test_the_estimator_for_the_noise_is_unbiased_and_the_other_off_by_it(at: str) -> None:
    support = noise(400_000, 1)
    beam, added = answer(support), noise(400_000, 2, 0.7)
    given, measured = (support, beam + added) if at == "output" else (support + added, beam)
    found = frequency_response(Signals(SLOW, given, measured), resolution=0.02)
    inside = (found.frequency > 3.0) & (found.frequency < 7.0)
    true = np.abs(exact(found.frequency[inside]))
    h1, h2 = (np.abs(h[inside]) / true for h in (found.h1, found.h2))
    right, other = (h1, h2) if at == "output" else (h2, h1)
    # noise power over that of the signal it is added to
    share = 0.7**2 / true**2 if at == "output" else np.full(len(true), 0.7**2)
    off = 1.0 + share if at == "output" else 1.0 / (1.0 + share)
    assert right.mean() == pytest.approx(1.0, abs=0.01)
    assert (other / off).mean() == pytest.approx(1.0, abs=0.02)
    assert found.coherence[inside].mean() == pytest.approx((1.0 / (1.0 + share)).mean(), abs=0.02)


def test_a_sweep_as_one_segment_has_the_response_at_each_line() -> None:
    """From rest to rest: the whole record as one segment without a window has no leakage."""
    time = np.arange(round(80.0 * SLOW)) / SLOW
    support = chirp(time, 1.0, 80.0, 12.0) * np.sin(math.pi * time / 80.0)
    support = np.concatenate([support, np.zeros(round(40.0 * SLOW))])
    found = frequency_response(Signals(SLOW, support, answer(support)), SLOW / len(support), "boxcar")
    lines = found.excited & (found.frequency < 12.0)
    assert np.count_nonzero(lines) > 1000
    for estimated in (found.h1, found.h2):
        np.testing.assert_allclose(estimated[lines], exact(found.frequency[lines]), rtol=1e-9)
    assert found.frequency[found.strongest] == pytest.approx(NATURAL * math.sqrt(1.0 - 2.0 * DAMPING**2), abs=0.02)
    assert found.averages == 1.0
    assert doubted(found, "averages")
    assert not found.trusted.any()
    assert np.isnan(found.relative_std).all()


def test_the_error_bars_of_h1_are_what_it_scatters_by() -> None:
    clean = noise(200_000, 4)
    found = frequency_response(Signals(RATE, clean, 2.0 * clean + noise(200_000, 5)), resolution=0.5)
    scatter = (np.abs(found.h1) / 2.0 - 1.0)[2:-2] / found.relative_std[2:-2]
    assert scatter.std() == pytest.approx(1.0, abs=0.15)
    assert abs(scatter.mean()) < 0.2


def test_low_coherence_is_named_and_no_excitation_refused() -> None:
    clean = noise(20_000, 6)
    good, bad = (
        frequency_response(Signals(RATE, clean, clean + noise(20_000, 7, size)), resolution=1.0) for size in (0.01, 3.0)
    )
    assert (doubted(good, "coherence"), doubted(bad, "coherence")) == (False, True)
    assert good.trusted[good.excited].all()
    assert not bad.trusted.all()
    with pytest.raises(AnalysisError, match="support_displacement"):
        frequency_response(Signals(RATE, np.zeros(5000), noise(5000, 1)))


def test_lines_too_far_apart_for_a_peak_are_named() -> None:
    """A resonance of 0.25 Hz width at lines 1 Hz apart: too low by half, and the two estimators differ."""
    pole = np.exp((-0.8 + 1j * TAU * 5.5) / RATE)
    given = noise(400_000, 8)
    response = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], given)
    coarse, fine = (frequency_response(Signals(RATE, given, response), step) for step in (1.0, 0.05))
    assert (doubted(coarse, "H1 and H2"), doubted(fine, "H1 and H2")) == (True, False)
    assert abs(coarse.h1[coarse.strongest]) < 0.8 * abs(fine.h1[fine.strongest])


# decrement


def decaying(duration: float = 3.0, ratio: float = 0.03, frequency: float = 5.5, offset: float = 0.2) -> Array:
    omega, time = TAU * frequency, np.arange(round(duration * RATE)) / RATE
    fall = ratio * omega / math.sqrt(1.0 - ratio**2)  # of the damped frequency
    return np.asarray(offset + 0.1 * np.exp(-fall * time) * np.cos(omega * time + 0.3))


@pytest.mark.parametrize("ratio", [0.001, 0.03, 0.3])
def test_an_exact_decay_gives_its_frequency_and_damping(ratio: float) -> None:
    found = free_decay(decaying(ratio=ratio), RATE, start=2.0)
    assert found.frequency == pytest.approx(5.5, rel=1e-8)
    assert found.damping_ratio == pytest.approx(ratio, rel=1e-7)
    assert found.log_decrement == pytest.approx(TAU * ratio / math.sqrt(1.0 - ratio**2), rel=1e-7)
    assert found.begin == 2.0
    if ratio == 0.03:
        np.testing.assert_allclose(found.ratios, math.exp(found.log_decrement), rtol=1e-3)
        assert found.doubts == ()


def test_the_error_bars_of_a_decay_cover_the_truth() -> None:
    found = [free_decay(decaying(duration=2.0) + noise(2000, seed, 1e-3), RATE) for seed in range(60)]
    frequency = [(one.frequency - 5.5) / one.frequency_std for one in found]
    damping = [(one.damping_ratio - 0.03) / one.damping_ratio_std for one in found]
    for off in (frequency, damping):
        assert 0.75 < np.std(off) < 1.3
        assert abs(np.mean(off)) < 0.5


def test_a_decay_that_is_short_or_not_exponential_is_doubted() -> None:
    assert doubted(free_decay(decaying(duration=0.5), RATE), "short: 2")
    time = np.arange(3000) / RATE
    dry = np.maximum(0.0, 0.1 - 0.04 * time) * np.cos(TAU * 5.5 * time)  # falls in a straight line: friction
    assert doubted(free_decay(dry, RATE), "exponential")
    with pytest.raises(AnalysisError, match="periods"):
        free_decay(decaying(duration=0.25), RATE)


def test_a_decay_after_the_excitation_is_found_and_a_simulated_one_has_the_beams_own_damping() -> None:
    support = np.concatenate([tone(5.5, 0.02, 4.0), np.zeros(3000)])
    beam = np.concatenate([tone(5.5, 0.1, 4.0), decaying(offset=0.0)])
    begin, end = find_decay(support, beam, RATE) or (0, 0)
    assert 4000 <= begin < 4200
    assert end == 7000
    assert find_decay(tone(5.5, 0.02, 7.0), tone(5.5, 0.1, 7.0), RATE) is None
    scene = standard_bench(
        excitation={"free": {"deflection": 0.2}}, ceiling={"height": 0.017}, duration=6.0, steady_window=[5.0, 6.0]
    )
    motion = trajectory(scene, RATE, "simplified")
    assert find_decay(motion.support, motion.beam, RATE) == (0, len(motion.beam))
    ratio = 0.5 * scene.beam.damping / math.sqrt(scene.total_mass * scene.beam.stiffness)
    assert free_decay(motion.beam, RATE).damping_ratio == pytest.approx(ratio, rel=1e-4)


# orders


def test_orders_have_their_amplitudes_and_phases_and_the_distortion() -> None:
    frequency, given = 5.4321, {1: (0.1, 0.5), 2: (0.01, -1.0), 3: (0.02, 2.0)}
    support = tone(frequency, 0.02, 6.0, 0.7)
    beam = sum((tone(k * frequency, a, 6.0, p + 0.7 * k) for k, (a, p) in given.items()), np.full(6000, -0.3))
    beam[100:400] = np.nan  # lost
    found = orders(Signals(RATE, support, beam), 4)
    assert (found.frequency, found.excitation) == pytest.approx((frequency, 0.02), rel=1e-6)
    np.testing.assert_allclose(found.amplitude[:3], [0.1, 0.01, 0.02], rtol=1e-4)
    np.testing.assert_allclose(found.phase[:3], [0.5, -1.0, 2.0], atol=1e-3)
    assert found.amplitude[3] < 1e-5
    assert found.distortion == pytest.approx(math.hypot(0.01, 0.02) / 0.1, rel=1e-4)
    assert found.doubts == ()


def test_a_square_wave_has_odd_orders_that_fall_as_one_over_k() -> None:
    """Fourier: 4/(pi k) for odd k; with samples beside the edges exact to (pi k f/rate)^2/6."""
    support = tone(5.0, 0.02, 20.0, math.pi * 5.0 / RATE)
    found = orders(Signals(RATE, support, np.sign(support)), 9)
    expected = [4.0 / (math.pi * k) if k % 2 else 0.0 for k in range(1, 10)]
    np.testing.assert_allclose(found.amplitude, expected, rtol=4e-3, atol=1e-9)
    np.testing.assert_allclose(found.phase[::2], 0.0, atol=1e-6)
    assert found.distortion == pytest.approx(math.sqrt(sum(1.0 / k**2 for k in (3, 5, 7, 9))), rel=4e-3)


def test_an_error_bar_is_what_an_amplitude_scatters_by() -> None:
    support, beam = tone(5.0, 0.02, 10.0), tone(5.0, 0.1, 10.0) + tone(10.0, 0.01, 10.0)
    made = [orders(Signals(RATE, support, beam + noise(10_000, seed, 0.02)), 2) for seed in range(40)]
    off = np.array([(one.amplitude - [0.1, 0.01]) / one.amplitude_std for one in made])
    assert off.std() == pytest.approx(1.0, abs=0.25)
    assert abs(off.mean()) < 0.4


@pytest.mark.parametrize(("last", "named"), [(5.0, False), (5.002, False), (5.05, True), (8.0, True)])
def test_an_excitation_that_drifts_in_frequency_is_named(last: float, named: bool) -> None:
    time = np.arange(20_000) / RATE
    support = 0.02 * np.sin(TAU * (5.0 * time + 0.5 * (last - 5.0) * time**2 / time[-1]))
    found = orders(Signals(RATE, support, 5.0 * support))
    assert doubted(found, "excitation's frequency") == named
    assert named or found.amplitude[0] == pytest.approx(0.1, rel=2e-3)
    # and so are irregular motion and a changing amplitude
    support, beam = tone(5.0, 0.02, 6.0), tone(5.0, 0.1, 6.0)
    assert doubted(orders(Signals(RATE, support, beam + tone(2.5, 0.05, 6.0))), "subharmonic")
    assert doubted(orders(Signals(RATE, support, beam * np.linspace(0.5, 1.0, 6000))), "amplitude")


def test_the_last_constant_part_is_fitted_a_long_one_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    support = np.concatenate([tone(5.0, 0.02, 6.0), tone(5.0, 0.04, 6.0), np.zeros(2000)])
    part = steady_part(Signals(RATE, support, support))
    assert 8.5 < part.start < 9.5
    assert 11.0 < part.start + part.duration <= 12.01
    assert tone_of(support, RATE) == pytest.approx(5.0, abs=0.05)
    signals = Signals(RATE, tone(5.0, 0.02, 6.0), tone(5.0, 0.1, 6.0, 0.4) + noise(6000, 1, 0.01))
    whole = orders(signals)
    monkeypatch.setattr(sys.modules["atpid_control.analysis.orders"], "_PIECE", 700)
    np.testing.assert_allclose(orders(signals).amplitude, whole.amplitude, rtol=1e-6)
    assert orders(signals).residual == pytest.approx(whole.residual, rel=1e-9)


# integration of accelerations


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(2.5, 40.0), st.floats(0.0, 0.1), st.floats(0.4, 1.0))
def test_a_record_is_integrated_to_within_its_drift(seed: int, frequency: float, level: float, corner: float) -> None:
    omega = TAU * frequency
    true = tone(frequency, 5e-3, 40.0, float(seed))
    found, drift = displacement_of(-(omega**2) * true + noise(true.size, seed, level) + 0.7, RATE, corner)
    known = np.isfinite(found)
    assert np.count_nonzero(~known) <= 4.0 * RATE / corner + 2
    # white noise above twice the corner is in it, too: a third of what is below
    assert np.sqrt(np.mean((found - true)[known] ** 2)) < 2.5 * drift + 2e-3 * 5e-3


def test_gaps_stay_and_what_drifts_is_refused() -> None:
    signal = tone(5.0, 1.0, 60.0)
    signal[30_000:30_010] = np.nan
    pair, lines = integrated(Signals(RATE, signal, signal, ("m", "m/s^2")), 1.0)
    assert np.isnan(pair.response[28_500:31_500]).all()
    assert pair.units == ("m", "m")
    np.testing.assert_allclose(pair.response[5000:20_000], -signal[5000:20_000] / (TAU * 5.0) ** 2, atol=1e-5)
    assert "2 Hz" in lines[0]
    with pytest.raises(AnalysisError, match="noise"):
        displacement_of(tone(0.4, 0.01, 60.0) + noise(60_000, 1, 1.0), RATE, 0.3)
    with pytest.raises(AnalysisError, match="60 s"):
        displacement_of(signal, RATE, 0.1)
    with pytest.raises(AnalysisError, match=r" m and m; .* m/s"):
        integrated(Signals(RATE, signal, signal), 1.0)


def test_signals_without_an_excitation_or_a_tone_are_analysed_too() -> None:
    found = analyse(Signals(RATE, np.full(4000, np.nan), tone(5.0, 1.0, 4.0), ("m", "m/s^2")))
    assert (found.response, "excitation" in found.skipped["orders"]) == (None, True)
    for one in (found, analyse(Signals(RATE, noise(8000, 1), noise(8000, 2)))):
        json.dumps(one.to_json(), allow_nan=False)


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


def test_the_command_writes_numbers_and_picture(tmp_path: Path, capsys: Capture) -> None:
    assert "tone" in printed(capsys, "bag", "analyse", ROOT / "bags/thesis_4_3_short", "--out", tmp_path)
    found = json.loads((tmp_path / "analysis.json").read_text())
    assert found["orders"]["frequency"] == pytest.approx(5.47, abs=0.01)
    assert found["orders"]["excitation"] == pytest.approx(0.025, rel=1e-3)
    assert found["orders"]["amplitude"][0] == pytest.approx(0.109, abs=0.003)
    assert "rest" in found["skipped"]["decrement"]
    assert (tmp_path / "analysis.png").stat().st_size > 20_000


def test_a_decay_in_a_bag_is_fitted(tmp_path: Path, capsys: Capture) -> None:
    bag = written(tmp_path / "bag", noise(3000, 1, 2e-5), decaying() + noise(3000, 2, 2e-5))
    found = answered(capsys, "bag", "analyse", bag, "--out", tmp_path / "out")
    assert found["decrement"]["damping_ratio"] == pytest.approx(0.03, rel=5e-3)
    assert abs(found["decrement"]["damping_ratio"] - 0.03) < 4.0 * found["decrement"]["damping_ratio_std"]
    assert "support_displacement" in found["skipped"]["frequency_response"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (".", [".mcap", ".db3"]),
        ("other", ["support_displacement", "beam_displacement", ": a, b"]),
        ("still", ["beam_displacement", "constant"]),
        ("other --input a --output b --resolution 0.1", ["10 s"]),
        ("other --input a --output b --from 9", ["0 to 3 s"]),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, capsys: Capture, arguments: str, words: list[str]) -> None:
    written(tmp_path / "other", noise(3000, 1), noise(3000, 2), ("a", "b"))
    written(tmp_path / "still", tone(5.0, 0.1, 1.0), np.zeros(1000))
    bag, *options = arguments.split()
    line = refusal(capsys, "bag", "analyse", tmp_path / bag, *options, "--out", tmp_path / "out")
    assert [word for word in words if word not in line] == []


def test_a_fault_within_the_part_is_named(tmp_path: Path, capsys: Capture) -> None:
    stuck = ["bag", "analyse", ROOT / "bags/laser_stuck", "--out", tmp_path / "all"]
    shown = printed(capsys, *stuck)
    (fault,) = json.loads((tmp_path / "all/analysis.json").read_text())["faults"]
    assert re.search(r"\b2\.699 s, identifier_node: support_displacement: frozen ", fault)
    assert fault in shown
    assert answered(capsys, *stuck, "--force", "--from", "4")["faults"] == []
