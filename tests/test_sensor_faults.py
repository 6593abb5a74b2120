# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A support laser that fails in the middle of a vibration, from its volts to what the hold decides: nothing new."""

from pathlib import Path

import numpy as np
import pytest

from atpid_common.channel_monitor import ChannelState
from atpid_control.identification import Identifier, Quality, Settings
from atpid_control.loop.hold import Hold, HoldSettings
from atpid_driver.calibration.channel_state import Thresholds, VoltageMonitor
from atpid_driver.calibration.model import load, si_of, volts_of

RATE, BLOCK, FAILS = 1000.0, 50, 2370
AMPLITUDE, FREQUENCY = 0.03, 5.49
THRESHOLDS = Thresholds(
    dead_time=0.2, frozen_time=1.0, converter_noise=6e-4, clipped_share=0.02, spike=0.2, spikes_per_second=3.0
)
IDENTIFIER = Settings(second_tone=0.0, slow_drift=0.0)
HOLD = HoldSettings(frequency=FREQUENCY, frequency_band=0.0)


def run(root: Path, phase: float, gives: float | None) -> tuple[ChannelState, list[float], Quality]:
    """Return the laser's last state, the amplitudes acted on after it failed, and the last estimate's quality.

    gives: the voltage after the failure [V]; None: frozen where it was.
    """
    laser = load(root / "atpid_driver" / "config" / "calibration" / "laser_support.yaml")
    t = np.arange(round(6.0 * RATE)) / RATE
    volts = volts_of(laser, AMPLITUDE * np.sin(2.0 * np.pi * FREQUENCY * t + phase))
    volts += np.random.default_rng(0).normal(0.0, 2.7e-4, t.size)
    volts[FAILS:] = volts[FAILS] if gives is None else gives
    monitor, identifier, hold = VoltageMonitor(laser, THRESHOLDS), Identifier(IDENTIFIER), Hold(HOLD)
    acted = []
    for first in range(0, t.size, BLOCK):
        part = volts[first : first + BLOCK]
        values, counts = si_of(laser, part)
        monitor.take(part, values, counts, RATE)
        if monitor.finding.state.severity == 2:
            values[:] = np.nan
        estimate = identifier.push(first, RATE, values, None, (first + BLOCK - 1) / RATE)
        verdict = hold.judge(estimate)
        if verdict.select:
            hold.acted(verdict.amplitude)
            acted += [verdict.amplitude] if first > FAILS else []
    return monitor.finding.state, acted, estimate.quality


PHASES = (0.27, 2.2, 3.3, 6.0)


@pytest.mark.parametrize(
    ("volts", "state"),
    [(0.2, ChannelState.BROKEN_LOOP), (5.4, ChannelState.OUT_OF_RANGE), (float("nan"), ChannelState.MISSING)],
)
def test_a_dead_laser_moves_nothing(root: Path, volts: float, state: ChannelState) -> None:
    for phase in PHASES:
        assert run(root, phase, volts) == (state, [], Quality.NONE)


def test_a_frozen_laser_never_raises_the_ceiling_and_ends_in_no_estimate(root: Path) -> None:
    """Until it is seen to be frozen its window looks like a vibration that dies away, which may lower the ceiling."""
    for phase in PHASES:
        state, acted, quality = run(root, phase, None)
        assert (state, quality) == (ChannelState.FROZEN, Quality.NONE)
        assert all(amplitude < AMPLITUDE for amplitude in acted)
