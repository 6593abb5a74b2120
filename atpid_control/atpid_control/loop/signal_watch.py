# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether a channel's readings can be those of a working sensor: dead, frozen and impossible ones are found.

Time is counted in samples. A sensor that is wrong but plausible is not found here: no single channel can show that.
"""

from dataclasses import dataclass

import numpy as np

from atpid_common.channel_monitor import ChannelMonitor, ChannelState, Finding
from atpid_common.parameters import live
from atpid_sim.system import Array

#: The motion before a stop is judged over so long [s].
_BEFORE = 1.0
#: A signal that stops with this share of its amplitude, in displacement and velocity together, has not come to rest.
_ABRUPT = 0.1


@dataclass(frozen=True)
class SignalSettings:
    """When a channel counts as faulty: parameters of the identifier."""

    dead_time: float = live(0.2, "a channel without one valid reading for so long is dead", "s", 0.01, 60.0)
    frozen_time: float = live(0.2, "a channel that stops in mid-motion for so long is frozen", "s", 0.01, 60.0)
    largest_velocity: float = live(
        30.0, "faster steps of a displacement are impossible; 0: not judged", "m/s", 0.0, 1e6
    )
    invalid_share: float = live(0.2, "share of invalid readings of a second that is intermittent", "-", 0.001, 1.0)
    recovery_time: float = live(0.5, "a channel plausible for so long works again", "s", 0.0, 60.0)


class SignalWatch(ChannelMonitor[int]):
    """Judges one channel; it is plausible again after `recovery_time`. Of each block its invalid readings are kept."""

    def __init__(self, settings: SignalSettings) -> None:
        super().__init__()
        self.settings = settings
        self._recent = np.empty(0)  # valid readings of the last `_BEFORE`, those that are constant left out
        self._constant = 0  # readings that are exactly the last one
        self._last = self._end = np.nan  # last valid reading; last reading

    def push(self, rate: float, readings: Array) -> Finding | None:
        """Take the next readings (n,) at `rate` [Hz], NaN where invalid; return a change of state, else None."""
        if not readings.size or not rate > 0.0:
            return None
        if self._begin(rate):
            self._recent, self._constant = np.empty(0), 0
        return self._settle(self._judge(readings), readings.size, self.settings.recovery_time)

    def _judge(self, readings: Array) -> Finding:
        limits, rate = self.settings, self._rate
        valid = np.isfinite(readings)
        self._count_unusable(valid)
        self._follow(readings[valid])
        steps = np.abs(np.diff(readings, prepend=self._end))  # NaN beside an invalid reading
        self._end = float(readings[-1])
        if self._unusable >= limits.dead_time * rate:
            self._blocks.clear()
            return Finding(ChannelState.INVALID, f"no valid reading for {limits.dead_time:g} s")
        fast = int(np.count_nonzero(steps > limits.largest_velocity / rate)) if limits.largest_velocity else 0
        if fast > 1:  # one may be the step at which a fault ends
            text = f"impossible readings: {fast} steps in a block of up to {float(np.nanmax(steps)) * rate:.3g} m/s"
            return Finding(ChannelState.IMPOSSIBLE, text)
        if self._constant >= limits.frozen_time * rate and self._stopped_abruptly():
            return Finding(ChannelState.FROZEN, f"frozen at {self._last:.5g} for {limits.frozen_time:g} s")
        full = self._keep(readings.size, int(np.count_nonzero(~valid)), _BEFORE)
        share = sum(invalid for _, invalid in self._blocks) / self._scans
        if full and share >= limits.invalid_share:
            text = f"intermittent: {share:.0%} of the readings of {_BEFORE:g} s are invalid"
            return Finding(ChannelState.INTERMITTENT, text)
        return Finding()

    def _follow(self, valid: Array) -> None:
        """Take the valid readings of a block: when they have last changed, and how they moved before."""
        if not valid.size:
            return
        joined = valid if np.isnan(self._last) else np.concatenate(([self._last], valid))
        steps = np.abs(np.diff(joined))
        moved = np.flatnonzero(steps > 0.0)
        if moved.size:
            until = joined[: moved[-1] + 2]
            keep = round(_BEFORE * self._rate)
            self._recent = np.concatenate((self._recent, until[1:] if self._recent.size else until))[-keep:]
            self._constant = steps.size - 1 - int(moved[-1])
        else:
            self._constant += steps.size
        self._last = float(valid[-1])

    def _stopped_abruptly(self) -> bool:
        """Whether the motion before the readings became constant had not decayed: then no structure stops like this."""
        before = self._recent
        if before.size < 8:
            return False
        velocity = np.diff(before)
        spread, speed = float(np.std(before)), float(np.std(velocity))
        if spread == 0.0 or speed == 0.0:
            return False
        displacement = (before[-1] - float(np.mean(before))) / spread
        return bool(np.hypot(displacement, velocity[-1] / speed) > _ABRUPT)


#: Crystals drift apart by less: stamps that do so follow the host's clock, as they should [-].
_CRYSTAL = 2e-4


class ClockWatch:
    """Compares the stamps of blocks with their indices: but for a crystal's drift both count the same time."""

    def __init__(self, tolerance: float) -> None:
        """Take how far the two may move apart [s]; 0: not compared."""
        self.tolerance = tolerance
        self.off = 0.0  # how far the stamps are off now [s]
        self.faulty = False
        self._start: float | None = None
        self._index = 0

    def push(self, stamp: float, first_index: int, rate: float) -> bool | None:
        """Take a block's stamp [s], the index of its first scan and its rate [Hz]; return a change: faulty or not."""
        if not (self.tolerance and rate > 0.0):
            return None
        start = stamp - first_index / rate
        if self._start is None or first_index < self._index:  # a stream begins
            self._start = start
        drifted = _CRYSTAL * max(0, first_index - self._index) / rate
        self._index = first_index
        self._start += min(max(start - self._start, -drifted), drifted)
        self.off = start - self._start
        faulty = abs(self.off) > self.tolerance
        changed, self.faulty = faulty != self.faulty, faulty
        return faulty if changed else None
