# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether a channel's voltage can be that of a working sensor, or it is dead, frozen, clipped or has spikes.

Time is counted in scans.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_common.channel_monitor import ChannelMonitor, ChannelState, Finding
from atpid_driver.calibration.model import Calibration, Counts, Floats


@dataclass(frozen=True)
class Thresholds:
    """When a channel counts as faulty."""

    dead_time: float  # a channel without one usable reading for so long is dead [s]
    frozen_time: float  # time over which a frozen channel, clipped readings and spikes are looked for [s]
    converter_noise: float  # readings of a constant voltage spread no further than this [V]
    clipped_share: float  # share of unusable readings from which a channel is clipped [-]
    spike: float  # a single reading further than this from both its neighbours is a spike [V]; 0: none is
    spikes_per_second: float  # from which they are reported [1/s]


@dataclass(frozen=True)
class _Part:
    """What is kept of one block."""

    counts: Counts
    spikes: int
    lowest: float  # [V], infinite where no reading
    highest: float


class VoltageMonitor(ChannelMonitor[_Part]):
    """Judges one channel; a better state holds when it has lasted for `frozen_time`."""

    def __init__(self, calibration: Calibration, thresholds: Thresholds) -> None:
        super().__init__()
        self.last_volts = np.nan  # the last reading [V]; NaN: none in the last block
        self.spread = np.nan  # largest less smallest reading of the last `frozen_time` [V]; NaN: not so long yet
        self._calibration, self._thresholds = calibration, thresholds
        self._full = False  # whether `frozen_time` has passed
        self._tail = np.empty(0)  # the last two readings [V]

    def take(self, volts: Floats, values: Floats, counts: Counts, rate: float) -> Finding | None:
        """Judge the next readings (n,) [V] at `rate` [Hz]; return a change of state, else None.

        volts: NaN where the device lost the scan; values, counts: what `si_of` made of them.
        """
        if not volts.size:
            return None
        self._begin(rate)
        self._take(volts, ~np.isnan(values), counts)
        return self._settle(self._found(), volts.size, self._thresholds.frozen_time)

    def _take(self, volts: Floats, usable: NDArray[np.bool_], counts: Counts) -> None:
        readings = volts[~np.isnan(volts)]
        self.last_volts = float(readings[-1]) if readings.size else np.nan
        lowest, highest = (float(readings.min()), float(readings.max())) if readings.size else (np.inf, -np.inf)
        if usable.any() and self._dead:  # what is judged next begins with the readings that return
            self._blocks.clear()
            counts = Counts()
        self._count_unusable(usable)
        part = _Part(counts, self._spikes(volts), lowest, highest)
        self._full = self._keep(volts.size, part, self._thresholds.frozen_time)
        highest, lowest = max(part.highest for _, part in self._blocks), min(part.lowest for _, part in self._blocks)
        self.spread = highest - lowest if self._full and highest >= lowest else np.nan

    @property
    def _dead(self) -> bool:
        return self._unusable >= self._thresholds.dead_time * self._rate

    def _spikes(self, volts: Floats) -> int:
        """Count the readings beyond both their neighbours; the last one is judged with the next block."""
        joined = np.concatenate((self._tail, volts))
        self._tail = joined[-2:]
        if not self._thresholds.spike:
            return 0
        before, after = joined[1:-1] - joined[:-2], joined[1:-1] - joined[2:]
        far = np.minimum(np.abs(before), np.abs(after)) > self._thresholds.spike
        return int(np.count_nonzero(far & (before * after > 0.0)))

    def _found(self) -> Finding:
        limits, calibration = self._thresholds, self._calibration
        low, high = calibration.limits_volts
        if self._dead:
            newest = self._blocks[-1][1].counts
            if newest.missing > newest.broken_loop + newest.out_of_range:
                return Finding(ChannelState.MISSING, f"no readings: the device gives none for {limits.dead_time:g} s")
            if newest.broken_loop > newest.out_of_range:
                below = f"below {calibration.broken_loop_volts:g} V"
                return Finding(ChannelState.BROKEN_LOOP, f"current loop broken: {self.last_volts:.3f} V, {below}")
            return Finding(
                ChannelState.OUT_OF_RANGE, f"out of range: {self.last_volts:.3f} V, allowed {low:g} to {high:g} V"
            )
        if self.spread <= limits.converter_noise:
            return Finding(
                ChannelState.FROZEN,
                f"frozen at {self.last_volts:.3f} V: within {1e3 * self.spread:.3g} mV for {limits.frozen_time:g} s",
            )
        return self._doubtful(low, high)

    def _doubtful(self, low: float, high: float) -> Finding:
        """Return a state in which the sensor still measures."""
        limits, scans = self._thresholds, self._scans
        parts = [part for _, part in self._blocks]
        broken = sum(part.counts.broken_loop for part in parts)
        outside = sum(part.counts.out_of_range for part in parts)
        share = (broken + outside) / scans
        # while a whole block is unusable it may be a dead sensor's beginning
        if self._full and share >= limits.clipped_share and self._unusable < self._blocks[-1][0]:
            loop = f", {broken / scans:.0%} with a broken loop" if broken else ""
            text = (
                f"clipped: {share:.0%} of the readings of {limits.frozen_time:g} s outside {low:g} to {high:g} V{loop}"
            )
            return Finding(ChannelState.CLIPPED, text)
        per_second = sum(part.spikes for part in parts) / scans * self._rate
        if self._full and limits.spike and per_second >= limits.spikes_per_second:
            return Finding(ChannelState.SPIKES, f"spikes: {per_second:.3g} a second of more than {limits.spike:g} V")
        return Finding()
