# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Injected faults of a sensor's channel and of the clock, in readings and stamps, block by block."""

import math
from collections.abc import Sequence

import numpy as np

from atpid_common.injected_faults import FAULT_KINDS, Injected, active_fault
from atpid_sim.system import Array

#: Channels of the simulated stand and the part that measures each.
PART_OF = {
    "support_displacement": "support_laser",
    "beam_displacement": "beam_laser",
    "beam_acceleration": "accelerometer",
}
#: Readings kept for a delay: the longest delay [s].
_KEPT = FAULT_KINDS["support_laser"]["delayed"].high
#: An intermittent clock is behind by so much [s].
_BEHIND = 0.5


class ChannelFaults:
    """The faults of one channel, injected into its readings; without one the readings are passed through unchanged."""

    def __init__(self, part: str, rate: float, seed: int) -> None:
        """Take the part (`PART_OF`), the channel's rate [Hz] and the seed of random readings."""
        self.part, self._rate, self._seed = part, rate, seed
        self._past = np.empty(0)  # what the working sensor read, up to `_KEPT`
        self._last = math.nan  # what was read last with the fault injected: where a stuck sensor stays

    def act(self, faults: Sequence[Injected], first_index: int, readings: Array) -> Array:
        """Return the readings (n,) that begin at scan `first_index`, with the faults of this part injected."""
        mine = [fault for fault in faults if fault.part == self.part]
        time = (first_index + np.arange(readings.size)) / self._rate
        known = np.concatenate((self._past, readings))
        out = readings.copy()
        for fault in mine:
            during = (time >= fault.begin) & (time < fault.end)
            if during.any():
                out[during] = self._faulty(fault, time, known, out)[during]
        longest = max((fault.value for fault in mine if fault.kind == "delayed"), default=0.0)
        keep = round(min(longest, _KEPT) * self._rate)
        self._past = known[known.size - keep :] if keep else np.empty(0)
        self._last = float(out[-1]) if out.size else self._last
        return out

    def _faulty(self, fault: Injected, time: Array, known: Array, readings: Array) -> Array:
        match fault.kind:
            case "off":
                return np.full_like(readings, np.nan)
            case "stuck":
                before = np.flatnonzero(time < fault.begin)
                return np.full_like(readings, readings[before[-1]] if before.size else self._last)
            case "garbage":
                generator = np.random.default_rng([self._seed, 7, round(time[0] * self._rate)])
                return generator.uniform(-fault.value, fault.value, readings.size)
            case "wrong":
                return readings * fault.value
            case "slow":
                return self._lagging(fault, time, readings)
            case "delayed":
                back = round(fault.value * self._rate)
                places = np.arange(known.size - readings.size, known.size) - back
                return np.where(places < 0, np.nan, known[np.maximum(places, 0)])
            case _:
                return np.where((time - fault.begin) % fault.value >= 0.5 * fault.value, np.nan, readings)

    def _lagging(self, fault: Injected, time: Array, readings: Array) -> Array:
        share = -math.expm1(-1.0 / (fault.value * self._rate))
        value, out = self._last, readings.copy()
        for place in range(readings.size):
            if time[place] < fault.begin or math.isnan(value):
                value = readings[place]
            elif not math.isnan(readings[place]):
                value += share * (readings[place] - value)
            out[place] = value
        return out


class StampFaults:
    """The faults of the clock that stamps blocks."""

    def __init__(self, seed: int) -> None:
        """Take the seed of random stamps."""
        self._seed = seed

    def shift(self, faults: Sequence[Injected], time: float, stamp_ns: int) -> int:
        """Return by how much [ns] the stamp `stamp_ns` of an instant `time` [s] after the start is off."""
        fault = active_fault(faults, time, "clock")
        return round(self._seconds(fault, time, stamp_ns) * 1e9) if fault else 0

    def _seconds(self, fault: Injected, time: float, stamp_ns: int) -> float:
        elapsed = time - fault.begin
        match fault.kind:
            case "off":
                return -stamp_ns * 1e-9
            case "stuck":
                return -elapsed
            case "garbage":
                generator = np.random.default_rng([self._seed, 8, round(time * 1e6)])
                return float(generator.uniform(-fault.value, fault.value))
            case "wrong":
                return fault.value
            case "slow":
                return -fault.value * elapsed
            case "delayed":
                return -fault.value
            case _:
                return -_BEHIND if fault.gap(time) else 0.0
