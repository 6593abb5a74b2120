# SPDX-License-Identifier: Apache-2.0
"""Whether a channel's readings can be those of a working sensor: dead, frozen and impossible ones are found.

Time is counted in samples. A sensor that is wrong but plausible is not found here: no single channel can show that.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum

import numpy as np

from atpid_sim.system import Array

#: The motion before a stop is judged over so long [s].
_BEFORE = 1.0
#: A signal that stops with this share of its amplitude, in displacement and velocity together, has not come to rest.
_ABRUPT = 0.1


class SignalState(Enum):
    """States of a channel; the value is what messages call it."""

    PLAUSIBLE = "plausible"
    DEAD = "no valid readings"
    FROZEN = "frozen"
    IMPOSSIBLE = "impossible readings"
    INTERMITTENT = "intermittent"


@dataclass(frozen=True)
class SignalSettings:
    """When a channel counts as faulty."""

    dead_time: float  # without one valid reading for so long it is dead [s]
    frozen_time: float  # that stops in mid-motion and reads exactly the same for so long it is frozen [s]
    largest_velocity: float  # steps between readings that are faster are impossible [unit of the channel / s]; 0: none
    recovery_time: float  # plausible for so long, it works again [s]
    invalid_share: float  # of the readings of a second from which they come intermittently [-]


class SignalWatch:
    """Judges one channel block by block; a fault holds at once, recovery after `recovery_time`."""

    def __init__(self, settings: SignalSettings) -> None:
        self.settings = settings
        self.state = SignalState.PLAUSIBLE
        self.text = "plausible"
        self._rate = 0.0
        self._invalid = self._better = 0  # samples without a valid reading; samples better than the state
        self._recent = np.empty(0)  # valid readings of the last `_BEFORE`, those that are constant left out
        self._counts: deque[tuple[int, int]] = deque()  # readings and invalid ones of the last blocks
        self._constant = 0  # readings that are exactly the last one
        self._last = self._end = np.nan  # last valid reading; last reading

    def push(self, rate: float, readings: Array) -> SignalState | None:
        """Take the next readings (n,) at `rate` [Hz], NaN where invalid; return the state where it has changed."""
        if not readings.size or not rate > 0.0:
            return None
        if rate != self._rate:
            self._rate, self._recent, self._constant = rate, np.empty(0), 0
            self._counts.clear()
        found, text = self._judge(readings)
        if found is self.state:
            self._better = 0
            return None
        if found is SignalState.PLAUSIBLE:
            self._better += readings.size
            if self._better < self.settings.recovery_time * rate:
                return None
        self.state, self.text, self._better = found, text, 0
        return found

    def _judge(self, readings: Array) -> tuple[SignalState, str]:
        limits, rate = self.settings, self._rate
        valid = np.flatnonzero(np.isfinite(readings))
        self._invalid = readings.size - 1 - int(valid[-1]) if valid.size else self._invalid + readings.size
        self._follow(readings[valid])
        steps = np.abs(np.diff(readings, prepend=self._end))  # NaN beside an invalid reading
        self._end = float(readings[-1])
        if self._invalid >= limits.dead_time * rate:
            self._counts.clear()
            return SignalState.DEAD, f"no valid reading for {limits.dead_time:g} s"
        fast = int(np.count_nonzero(steps > limits.largest_velocity / rate)) if limits.largest_velocity else 0
        if fast > 1:  # one may be the step at which a fault ends
            fastest = float(np.nanmax(steps)) * rate
            return SignalState.IMPOSSIBLE, f"impossible readings: {fast} steps in a block of up to {fastest:.3g} m/s"
        if self._constant >= limits.frozen_time * rate and self._stopped_abruptly():
            return SignalState.FROZEN, f"frozen at {self._last:.5g} for {limits.frozen_time:g} s"
        share = self._share(readings.size, readings.size - valid.size)
        if share >= limits.invalid_share:
            return SignalState.INTERMITTENT, f"intermittent: {share:.0%} of the readings of {_BEFORE:g} s are invalid"
        return SignalState.PLAUSIBLE, "plausible again"

    def _share(self, readings: int, invalid: int) -> float:
        """Take the counts of a block; return the share of invalid readings over `_BEFORE`, 0 until that has passed."""
        self._counts.append((readings, invalid))
        total = sum(count for count, _ in self._counts)
        while total - self._counts[0][0] >= _BEFORE * self._rate:
            total -= self._counts.popleft()[0]
        return sum(count for _, count in self._counts) / total if total >= _BEFORE * self._rate else 0.0

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


class ClockWatch:
    """Compares the stamps of blocks with their indices: both count the same time."""

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
        self._index = first_index
        self.off = start - self._start
        faulty = abs(self.off) > self.tolerance
        changed, self.faulty = faulty != self.faulty, faulty
        return faulty if changed else None
