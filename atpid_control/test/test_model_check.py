# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Predicted against measured: drift is said once, and not for noise, transients or what the twin cannot say."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from atpid_control.loop.drift import DriftAlarm, DriftSettings, ModelCheck

TONE = (0.015, 5.0)


class Fixed:
    """Expects the same everywhere."""

    def __init__(self, amplitude: float) -> None:
        self.amplitude, self.asked = amplitude, 0

    def expected(self, amplitude: float, frequency: float, height: float) -> float:
        del amplitude, frequency, height
        self.asked += 1
        return self.amplitude


def check(expected: float = 0.1) -> tuple[ModelCheck, Fixed]:
    twin = Fixed(expected)
    return ModelCheck(twin, DriftAlarm(DriftSettings(tolerance=0.15, noise=0.02, periods=1e4))), twin


def said(reality: ModelCheck, swings: Sequence[float] | NDArray[np.float64], start: float = 0.0) -> list[float]:
    """Return the times at which something was said, one estimate each 50 ms."""
    times = start + 0.05 * np.arange(len(swings))
    return [float(t) for t, s in zip(times, swings, strict=True) if reality.check(float(t), TONE, 0.3, s)]


def test_drift_is_reported_once_with_both_amplitudes() -> None:
    reality, _ = check()
    texts = [reality.check(0.05 * k, TONE, 0.3, 0.14) for k in range(2000)]
    assert [text for text in texts if text] == [
        "the beam's amplitude is 40% above the model's (0.1400 m against 0.1000 m): check grain, beam and scene"
    ]


def test_too_little_is_drift_as_well() -> None:
    reality, _ = check()
    assert len(said(reality, [0.07] * 1000)) == 1


def test_the_twin_is_simulated_once_a_period() -> None:
    reality, twin = check()
    said(reality, [0.1] * 400)  # 20 s at 5 Hz
    assert 80 <= twin.asked <= 100


def test_noise_and_what_the_model_is_allowed_to_be_off_say_nothing_in_ten_minutes() -> None:
    reality, _ = check()
    swings = 0.112 * (1.0 + 0.02 * np.random.default_rng(1).standard_normal(12_000))
    assert said(reality, swings) == []


@pytest.mark.parametrize(("expected", "swing"), [(math.nan, 0.2), (0.1, math.nan)])
def test_what_is_unknown_is_no_drift(expected: float, swing: float) -> None:
    reality, _ = check(expected)
    assert said(reality, [swing] * 1000) == []


def test_a_reported_drift_is_latched_until_there_is_agreement() -> None:
    reality, _ = check()
    assert len(said(reality, [0.14] * 500)) == 1
    reality.restart()
    assert said(reality, [0.14] * 500, start=25.0) == []
    reality.restart()
    assert said(reality, [0.1] * 500, start=50.0) == []
    assert len(said(reality, [0.14] * 500, start=75.0)) == 1
