# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The state of a channel from its voltage: what is reported, how soon, and that a quiet sensor is none of it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from atpid_common.channel_monitor import ChannelState
from atpid_driver.calibration.channel_state import Thresholds, VoltageMonitor
from atpid_driver.calibration.model import Calibration, Floats, load, si_of

RATE, BLOCK = 1000.0, 50
LASER = load(Path(__file__).parents[1] / "config" / "calibration" / "laser_support.yaml")  # 1 to 5 V, 75 mm/V
USUAL = Thresholds(
    dead_time=0.2, frozen_time=1.0, converter_noise=6e-4, clipped_share=0.02, spike=0.2, spikes_per_second=3.0
)
SENSOR_NOISE = 2.7e-4  # 20 um of the ZX1-LD300A81 at 1 kHz (thesis section 2.2) [V]


def noise(seconds: float, deviation: float = SENSOR_NOISE) -> Floats:
    return np.random.default_rng(0).normal(0.0, deviation, round(seconds * RATE))


def tone(seconds: float, amplitude: float = 0.4, frequency: float = 5.5) -> Floats:
    """A working laser: a tone [V] about the middle of its range."""
    t = np.arange(round(seconds * RATE)) / RATE
    return 3.0 + amplitude * np.sin(2.0 * np.pi * frequency * t) + noise(seconds)


def changes(
    volts: Floats, thresholds: Thresholds = USUAL, calibration: Calibration = LASER
) -> list[tuple[float, ChannelState, str]]:
    """Return (time of the block's end [s], state, text) of each change."""
    monitor, seen = VoltageMonitor(calibration, thresholds), []
    for first in range(0, volts.size, BLOCK):
        part = volts[first : first + BLOCK]
        found = monitor.take(part, *si_of(calibration, part), RATE)
        if found is not None:
            seen.append(((first + part.size) / RATE, found.state, found.text))
    return seen


def states(volts: Floats) -> list[ChannelState]:
    return [state for _, state, _ in changes(volts)]


def test_a_working_laser_is_plausible_and_one_at_rest_not_frozen() -> None:
    """Ten minutes of noise alone, at half the laser's own, too."""
    assert changes(tone(20.0)) == []
    assert changes(tone(4.0, amplitude=1.8, frequency=40.0)) == [], "half the range at 40 Hz"
    for deviation in (SENSOR_NOISE, 1.5e-4):
        assert changes(3.0 + noise(600.0, deviation)) == []


@pytest.mark.parametrize(
    ("volts", "state", "parts"),
    [
        (0.2, ChannelState.BROKEN_LOOP, r"0\.200 V.* 0\.9 V"),
        (0.95, ChannelState.OUT_OF_RANGE, r"0\.950 V.* 1 to 5 V"),
        (5.4, ChannelState.OUT_OF_RANGE, r"5\.400 V.* 1 to 5 V"),
        (np.nan, ChannelState.MISSING, r" 0\.2 s"),
    ],
)
def test_a_dead_sensor_is_named_after_the_dead_time(volts: float, state: ChannelState, parts: str) -> None:
    ((time, found, text),) = changes(np.concatenate((tone(2.0), np.full(3000, volts))))
    assert (time, found, found.severity) == (2.2, state, 2)
    assert re.search(parts, text)


@pytest.mark.parametrize("at", [3.1, 1.01, 4.99])
def test_a_frozen_sensor_is_named_after_the_frozen_time(at: float) -> None:
    """Frozen means: no more than what the converter adds, here a step of 0.3 mV to either side."""
    converter = 3.05e-4 * np.random.default_rng(1).integers(-1, 1, 3000)
    ((time, state, text),) = changes(np.concatenate((tone(2.0), at + converter)))
    assert state is ChannelState.FROZEN
    assert 3.0 <= time <= 3.1
    stated = re.search(r"(\d\.\d+) V.* 0\.305 mV .* 1 s", text)
    assert stated
    assert float(stated[1]) == pytest.approx(at, abs=1e-3)


def test_clipping_is_a_share_of_the_readings() -> None:
    ((_, state, text),) = changes(np.minimum(tone(3.0, amplitude=2.5), 5.3))
    assert state is ChannelState.CLIPPED
    share = float(np.mean(np.abs(tone(3.0, amplitude=2.5) - 3.0) > 2.0))
    assert {f"{share:.0%}", "1", "5"} <= set(text.split())
    assert re.search(r" \d+% .*broken", text)
    volts = tone(3.0)
    volts[1500] = 5.5  # one reading is no clipping
    assert changes(volts, replace(USUAL, spike=0.0)) == []


def test_spikes_are_counted_at_the_end_of_a_block_too() -> None:
    volts = tone(4.0)
    volts[1000::200] += 0.3
    ((time, state, text),) = changes(volts)
    assert state is ChannelState.SPIKES
    assert {"3", "0.2"} <= set(text.split())
    assert 1.4 <= time <= 1.7
    assert changes(volts, replace(USUAL, spike=0.0)) == []
    volts = tone(3.0)
    volts[1000 + BLOCK - 1 :: 4 * BLOCK] += 0.3
    assert states(volts) == [ChannelState.SPIKES]


def test_a_sensor_that_returns_is_plausible_when_it_has_been_for_a_while() -> None:
    volts = tone(8.0)
    volts[2000:4000] = 0.2
    lost, back = changes(volts)
    assert lost[1] is ChannelState.BROKEN_LOOP
    assert back[1] is ChannelState.PLAUSIBLE
    assert 5.0 <= back[0] <= 6.1
    # a loose contact is one fault
    volts = tone(10.0)
    volts[(np.arange(volts.size) // 300) % 2 == 1] = 0.1
    assert states(volts) == [ChannelState.BROKEN_LOOP]


def test_a_channel_without_broken_loop_threshold() -> None:
    calibration = LASER.model_copy(update={"broken_loop_volts": None})
    ((_, state, _),) = changes(np.full(1000, 0.2), calibration=calibration)
    assert state is ChannelState.OUT_OF_RANGE


@given(
    st.lists(st.sampled_from([0.0, 0.5, 3.1, 5.5, np.nan, np.inf, -np.inf, -9999.0, 1e308]), min_size=1, max_size=400),
    st.integers(1, 97),
)
def test_whatever_a_converter_gives_is_a_state(volts: list[float], block: int) -> None:
    monitor, array = VoltageMonitor(LASER, USUAL), np.array(volts)
    with np.errstate(all="ignore"):
        for first in range(0, array.size, block):
            part = array[first : first + block]
            found = monitor.take(part, *si_of(LASER, part), 100.0)
            assert found is None or (found.text and "\n" not in found.text)
    assert monitor.finding.state in ChannelState
