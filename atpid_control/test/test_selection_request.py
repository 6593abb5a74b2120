# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A request for a height: what is nonsense is refused with what was given and what is allowed."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_control.identification import Estimate, Quality
from atpid_control.selection import SelectionError
from atpid_control.selection.checks import HeightRequest, Resonance, resolved

RESONANCE = Resonance(5.47, 0.03)
LATEST = Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=5.5)


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (HeightRequest(-1.0), "amplitude: given -1; allowed: above 0, or 0 for the latest steady estimate"),
        (HeightRequest(math.nan), "amplitude: given nan;"),
        (HeightRequest(math.inf), "amplitude: given inf;"),
        (HeightRequest(0.03, amplitude_std=-1.0), "amplitude_std: given -1; allowed: 0 or above"),
        (HeightRequest(0.03, amplitude_std=math.nan), "amplitude_std: given nan;"),
        (HeightRequest(0.03, margin=-3.0), "margin: given -3; allowed: 0 to 100 standard deviations"),
        (HeightRequest(0.03, margin=1e9), "margin: given 1e+09"),
        (HeightRequest(0.03, margin=math.nan), "margin: given nan"),
        (
            HeightRequest(0.03, frequency=9.0),
            "frequency: given 9 Hz; allowed: 5.47 Hz within 3 %, or 0 for that resonance",
        ),
        (HeightRequest(0.03, frequency=-5.47), "frequency: given -5.47 Hz"),
        (HeightRequest(0.03, frequency=math.nan), "frequency: given nan Hz"),
    ],
)
def test_nonsense_is_refused(request_: HeightRequest, text: str) -> None:
    with pytest.raises(SelectionError) as refused:
        resolved(request_, LATEST, RESONANCE)
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


def test_zero_stands_for_the_latest_estimate_and_the_resonance() -> None:
    assert resolved(HeightRequest(0.0, margin=3.0), LATEST, RESONANCE) == HeightRequest(0.03, 1e-5, 5.5, 3.0)
    assert resolved(HeightRequest(0.02), LATEST, RESONANCE) == HeightRequest(0.02, 0.0, 5.47, 0.0)


def test_an_estimate_off_resonance_is_refused_as_in_the_loop() -> None:
    with pytest.raises(SelectionError, match=r"frequency: given 6\.5 Hz"):
        resolved(
            HeightRequest(0.0),
            Estimate(quality=Quality.STEADY, amplitude=0.03, amplitude_std=1e-5, frequency=6.5),
            RESONANCE,
        )


def test_a_method_for_any_frequency_is_asked_from_half_to_twice_the_natural_one() -> None:
    wide = replace(RESONANCE, reach=(2.735, 10.94))
    assert resolved(HeightRequest(0.02, frequency=9.0), LATEST, wide).frequency == 9.0
    assert resolved(HeightRequest(0.02), LATEST, wide).frequency == 5.47
    with pytest.raises(
        SelectionError, match=r"frequency: given 11 Hz; allowed: 2\.735 to 10\.94 Hz, or 0 for 5\.47 Hz"
    ):
        resolved(HeightRequest(0.02, frequency=11.0), LATEST, wide)


def test_without_an_estimate_an_amplitude_is_needed() -> None:
    with pytest.raises(SelectionError, match="no steady estimate yet"):
        resolved(HeightRequest(0.0), None, RESONANCE)


@given(*[st.floats()] * 4)
def test_what_is_accepted_can_be_computed(
    amplitude: float, amplitude_std: float, frequency: float, margin: float
) -> None:
    try:
        asked = resolved(HeightRequest(amplitude, amplitude_std, frequency, margin), LATEST, RESONANCE)
    except SelectionError:
        return
    assert 0.0 < asked.amplitude < math.inf
    assert 0.0 <= asked.amplitude_std < math.inf
    assert 0.0 <= asked.margin <= 100.0
    assert asked.frequency == pytest.approx(5.47, rel=0.0301)
