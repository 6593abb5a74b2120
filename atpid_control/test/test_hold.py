# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The dead band and hold, the comparison with the model, and the loop check: what moves the ceiling, what does not."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atpid_control.identification import Estimate, Quality
from atpid_control.loop.drift import DriftAlarm, DriftSettings, ModelCheck
from atpid_control.loop.hold import OFF_RESONANCE, Hold, HoldDecision, HoldError, HoldSettings
from atpid_control.supervision.loop_check import Ceiling, LatestBlocks, LoopSnapshot, failures

SETTINGS: dict[str, Any] = {"dead_band": 0.01, "sigmas": 4.0, "frequency": 5.49, "frequency_tolerance": 0.05}
SETTINGS |= {"steady_count": 4, "rising_count": 4, "falling_count": 2}
#: Of a method that selects at any frequency.
ANYWHERE: dict[str, Any] = {"reach": (2.7, 11.0), "frequency_band": 0.0025}
INSIDE = "inside dead band"


def hold(**changes: Any) -> Hold:
    return Hold(HoldSettings(**(SETTINGS | changes)))


def steady(amplitude: float, std: float = 1e-6, frequency: float = 5.49, **changes: Any) -> Estimate:
    made = Estimate(quality=Quality.STEADY, amplitude=amplitude, amplitude_std=std, frequency=frequency)
    return replace(made, **changes)


def transient(amplitude: float) -> Estimate:
    return steady(amplitude, 1e-4, quality=Quality.TRANSIENT)


def decided(machine: Hold, estimates: Sequence[Estimate]) -> list[HoldDecision]:
    """Return the verdicts to select, each acted on."""
    acted = []
    for verdict in map(machine.judge, estimates):
        if verdict.select:
            machine.acted(verdict.amplitude, verdict.frequency)
            acted.append(verdict)
    return acted


def feed(machine: Hold, estimates: Sequence[Estimate]) -> list[float]:
    """Return the amplitudes acted on."""
    return [verdict.amplitude for verdict in decided(machine, estimates)]


@pytest.fixture
def machine() -> Hold:
    """Return a hold that has acted on 0.015 m."""
    made = hold()
    assert feed(made, [steady(0.015)] * 3) == []  # not before it is sure
    assert feed(made, [steady(0.015)] * 100) == [0.015]
    assert made.judge(steady(0.015)).reason == INSIDE
    return made


def test_noise_moves_nothing_in_ten_minutes() -> None:
    amplitudes = 0.015 * (1.0 + 0.002 * np.random.default_rng(1).standard_normal(12_000))
    assert len(feed(hold(), [steady(a, 0.002 * 0.015) for a in amplitudes])) == 1


def test_a_change_must_stand_out_of_the_error_bar(machine: Hold) -> None:
    assert feed(machine, [steady(0.0155, std=2e-4)] * 50) == []
    assert feed(machine, [steady(0.0155, std=1e-5)] * 50) == [0.0155]


def test_a_single_rising_transient_is_not_chased_but_ramps_are_followed(machine: Hold) -> None:
    assert feed(machine, [transient(0.03), transient(0.02), transient(0.028), transient(0.021)] * 5) == []
    assert feed(machine, [transient(0.016 + 0.001 * k) for k in range(8)])
    falling = hold()
    feed(falling, [steady(0.04)] * 4)
    assert feed(falling, [transient(0.038), transient(0.036)]) == [0.036]


def test_differences_of_rounding_are_no_ramp_and_no_change() -> None:
    machine, noiseless = hold(), 1e-17
    feed(machine, [transient(0.00095), transient(0.00098)])
    assert feed(machine, [steady(0.001 * (1.0 + k * 2.0**-52), noiseless) for k in range(3)]) == []
    assert feed(machine, [steady(0.001, noiseless)]) == [0.001]
    for edge in (0.00101 * (1.0 - 2.0**-50), 0.00101 * (1.0 + 2.0**-50)):
        assert feed(machine, [steady(edge, noiseless)] * 8) == []


def test_the_ends_of_the_frequencies_belong_to_them_however_they_round() -> None:
    for ends in ({"reach": (5.0, 6.0)}, {"frequency": 5.5, "frequency_tolerance": 0.5 / 5.5}):
        for frequency in (5.0 * (1.0 - 1e-15), 6.0 * (1.0 + 1e-15)):
            assert hold(**ends).reason_to_reject(steady(0.015, frequency=frequency)) == ""
        for frequency in (4.99, 6.01):
            assert hold(**ends).reason_to_reject(steady(0.015, frequency=frequency)) == OFF_RESONANCE
            assert hold(**ends).judge(steady(0.015, frequency=frequency)).refused


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"quality": Quality.NONE, "amplitude": math.nan}, "no"),
        ({"quality": Quality.POOR, "amplitude_std": 1e-3}, "poor"),
        ({"amplitude": math.nan}, "number"),
        ({"amplitude_std": math.inf}, "number"),
        ({"frequency": math.nan}, "number"),
        ({"amplitude": -0.015}, "positive"),
        ({"amplitude": 0.03, "frequency": 6.0}, "resonance"),
    ],
)
def test_an_estimate_that_cannot_be_trusted_moves_nothing(machine: Hold, changes: dict[str, Any], word: str) -> None:
    verdict = machine.judge(replace(steady(0.015), **changes))
    assert (verdict.select, word in verdict.reason.split()) == (False, True)
    assert machine.acted_amplitude == 0.015


def test_trouble_interrupts_what_was_nearly_sure() -> None:
    machine = hold()
    feed(machine, [steady(0.015)] * 3)
    machine.judge(steady(0.015, 1e-3, quality=Quality.POOR))
    assert feed(machine, [steady(0.015)] * 3) == []


def test_contradictory_settings_are_refused_in_one_line() -> None:
    bad = {"dead_band": (-0.1, math.nan), "steady_count": (0,), "rising_count": (1,), "frequency": (math.nan,)}
    for name, values in bad.items():
        for value in values:
            with pytest.raises(HoldError, match=rf"^{name}: given {value}.*; allowed: [^\n]*$"):
                hold(**{name: value})


# at any frequency


def test_another_frequency_is_selected_for_though_the_amplitude_is_the_same() -> None:
    machine = hold(**ANYWHERE)
    for frequency, expected in ((5.49, True), (5.50, False), (5.55, True), (5.54, False), (5.30, True)):
        chosen = decided(machine, [steady(0.015, frequency=frequency)] * 6)
        assert [verdict.frequency for verdict in chosen] == [frequency] * expected


def test_a_drifting_frequency_is_followed_in_steps_of_its_band() -> None:
    drifting = [steady(0.015, frequency=5.3 * (1.0 + 0.0005 * k)) for k in range(200)]  # 10 s at 1 % a second
    frequencies = [verdict.frequency for verdict in decided(hold(**ANYWHERE), drifting)]
    steps = np.diff(frequencies) / frequencies[:-1]
    assert 20 <= len(frequencies) <= 42
    assert steps.min() > 0.0025 * 0.99
    assert steps.max() < 0.006


def test_a_frequency_without_a_height_is_not_tried_again_nor_one_inside_its_noise() -> None:
    machine = hold(**ANYWHERE)
    verdict = [machine.judge(steady(0.015)) for _ in range(4)][-1]
    machine.failed(verdict.amplitude, verdict.frequency)
    assert decided(machine, [steady(0.015)] * 20) == []
    assert decided(machine, [steady(0.015, frequency=5.6)] * 6)
    noisy = steady(0.015, frequency=5.63, frequency_std=0.01)  # inside its noise
    assert decided(machine, [noisy] * 20) == []


def test_a_height_that_comes_late_is_taken_for_a_frequency_that_drifts() -> None:
    machine = hold(**ANYWHERE)
    assert machine.agrees(0.015, steady(0.015, frequency=5.49 * 1.009), 5.49)
    assert not machine.agrees(0.015, steady(0.015, frequency=5.6), 5.49)


# predicted against measured


class Twin:
    """Expects the same everywhere."""

    def __init__(self, amplitude: float = 0.1) -> None:
        self.amplitude, self.asked = amplitude, 0

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        self.asked += 1
        return self.amplitude


class Check:
    """The beam compared with a twin, one estimate each 50 ms."""

    def __init__(self, expected: float = 0.1) -> None:
        self.twin, self.time = Twin(expected), 0.0
        self.check = ModelCheck(self.twin, DriftAlarm(DriftSettings(tolerance=0.15, noise=0.02, periods=1e4)))

    def said(self, swings: Sequence[float] | NDArray[np.float64]) -> list[str]:
        texts = []
        for swing in swings:
            texts.append(self.check.check(self.time, (0.015, 5.0), 0.3, float(swing)))
            self.time += 0.05
        return [text for text in texts if text]


@pytest.mark.parametrize("swing", [0.14, 0.07])
def test_drift_is_reported_once_with_both_amplitudes_by_one_simulation_a_period(swing: float) -> None:
    reality = Check()
    (text,) = reality.said([swing] * 2000)
    assert re.findall(r"[\d.]+", text) == [f"{abs(swing / 0.1 - 1.0):.0%}"[:-1], f"{swing:.4f}", "0.1000"]
    reality = Check()
    reality.said([0.1] * 400)  # 20 s at 5 Hz
    assert 80 <= reality.twin.asked <= 100
    # what is unknown is no drift, nor what the model is allowed to be off, in ten minutes of noise
    assert Check(math.nan).said([0.2] * 1000) == Check(0.1).said([math.nan] * 1000) == []
    assert Check().said(0.112 * (1.0 + 0.02 * np.random.default_rng(1).standard_normal(12_000))) == []


def test_a_reported_drift_is_latched_until_there_is_agreement() -> None:
    reality, heard = Check(), []
    for swing in (0.14, 0.14, 0.1, 0.14):
        heard.append(len(reality.said([swing] * 500)))
        reality.check.restart()
    assert heard == [1, 0, 0, 1]


# the loop check

CEILING = Ceiling(0.017, 1.0, 0.3)


def sensors(**channels: float) -> LatestBlocks:
    """The channels, each with this share of valid readings in a block at 10 s."""
    made = LatestBlocks()
    for name, valid in channels.items():
        values = np.zeros(100)
        values[round(100 * valid) :] = math.nan
        made.push(name, values, 10.0)
    return made


RIGHT = LoopSnapshot(sensors(support=1.0, beam=0.9), scene=CEILING, motor=CEILING, recording=True, written=5)
NOW = 10.05


def test_a_loop_in_order_passes_and_all_that_fails_is_named_at_once() -> None:
    assert failures(RIGHT, NOW) == []
    assert failures(replace(RIGHT, scene=None, motor=None), NOW) == [], "a ceiling that no controller moves"
    assert failures(replace(RIGHT, recorder_expected=False, recording=False), NOW) == []
    assert failures(replace(RIGHT, motor=Ceiling(0.01, 1.2, 0.3)), NOW) == [], "a motor that can do more"
    assert len(failures(LoopSnapshot(scene=CEILING, errors={"beam": "dead"}), 0.0)) == 4
    (old,) = failures(replace(RIGHT, sensors=sensors(beam=1.0)), 12.0)
    assert re.search(r"^beam: .*2\.0 s", old)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"sensors": LatestBlocks()}, "^sensors: "),
        ({"sensors": sensors(support=1.0, beam=0.4)}, r"^beam: 40\s?%"),
        ({"errors": {"beam": "frozen at 3.1 V"}}, r"^beam: frozen at 3\.1 V"),
        ({"motor": None}, "^motor_node: .*limits"),
        ({"motor": Ceiling(0.02, 1.0, 0.3)}, r"0\.017 to 1 m, .* 0\.02 to 1 m"),
        ({"motor": Ceiling(0.017, 0.9, 0.3)}, r"0\.017 to 1 m, .* 0\.017 to 0\.9 m"),
        ({"motor": Ceiling(0.017, 1.0, 0.2)}, r"0\.3 m/s, .* 0\.2 m/s"),
        ({"recording": False}, "^recorder_node: .*open"),
        ({"written": 0}, "^recorder_node: .*written"),
    ],
)
def test_what_fails_is_named(change: dict[str, object], line: str) -> None:
    (found,) = failures(replace(RIGHT, **change), NOW)  # type: ignore[arg-type]
    assert re.search(line, found)
