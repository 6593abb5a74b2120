# SPDX-License-Identifier: Apache-2.0
"""Out of a rumble: when the height is to blame, how far the ceiling steps back, and that it does not return."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from atpid_control.loop.errors import HoldError

#: A beam that swings less than this share of what it did so many estimates ago is calming down.
_FALLING, _DECAY = 0.97, 8

#: A rumble that comes back so often where the ceiling stands is one, however short each burst.
_BURSTS = 2


@dataclass(frozen=True)
class StepBack:
    """How the ceiling leaves a rumble; the parameter file says the values."""

    share: float  # of the clearance above the lowest height given up each time [-]
    settle: int  # estimates after the ceiling has come to rest in which the beam may do anything
    count: int  # estimates that rumble after that, fading ones left out, before each step
    excess: float  # amplitude of the beam above the predicted that is more than inaccuracy [-]
    memory: float  # change of the excitation's amplitude over which a step back is remembered [-]

    def __post_init__(self) -> None:
        """Refuse a step that is none or crosses the lowest height."""
        if not 0.0 < self.share < 1.0:
            raise HoldError(f"step_back: given {self.share}; allowed: above 0 and below 1")
        if self.count < 1 or self.settle < 0:
            given = f"{self.count} and {self.settle}"
            raise HoldError(f"rumble_count and settle_count: given {given}; allowed: at least 1 and at least 0")
        for name, given_value in (("step_back_excess", self.excess), ("step_back_memory", self.memory)):
            if not given_value >= 0.0:
                raise HoldError(f"{name}: given {given_value}; allowed: at least 0")


class Retreat:
    """Watches one ceiling: tells when to step back, by how much, and what a later selection may have of it."""

    def __init__(self, settings: StepBack, lowest: float) -> None:
        """Take the settings and the lowest height of the ceiling [m]."""
        self._settings, self._lowest = settings, lowest
        self._rumbling = False
        self._rumbled = 0  # estimates for which the height is to blame
        self._stood = 0  # estimates in a row with the ceiling where it was sent
        self._bursts = 0  # rumbles that began with the ceiling standing and the beam too large
        self._limit = math.nan  # amplitude of the beam from which it is too large [m], NaN: any
        self._swings: deque[float] = deque(maxlen=_DECAY)  # the beam's latest amplitudes [m]
        self._amplitude = math.nan  # of the excitation it stepped back at [m]
        self._kept = 1.0  # share of the selected clearance that was left then [-]

    @property
    def settled(self) -> bool:
        """Whether the ceiling has stood for the settling time and the beam is regular."""
        return self._stood > self._settings.settle and not self._rumbling

    def configure(self, settings: StepBack) -> None:
        """Step back by other settings from the next estimate on."""
        self._settings = settings

    def on_event(self, kind: str) -> None:
        """Take note of an event: `rumble`, or `calm` when that has ended."""
        if kind not in ("rumble", "calm"):
            return
        self._rumbling = kind == "rumble"
        if self._rumbling and self._stood > self._settings.settle and self._swings:
            # the watch sees a burst when it is nearly over: that it was too large shows behind it
            self._bursts += not max(self._swings) <= self._limit

    def watch(self, swing: float, expected: float, standing: bool) -> bool:
        """Take one more estimate; return whether it is time for a step.

        swing, expected: the beam's amplitude measured and predicted [m], NaN: unknown; standing: the ceiling is where
        it was sent. The height is to blame where the ceiling stands and the beam rumbles, too large, without calming
        down: on the way, and while what was swinging before dies out, the response is irregular at any height.
        """
        self._swings.append(swing)
        dying = len(self._swings) == _DECAY and swing < _FALLING * self._swings[0]
        self._limit = (1.0 + self._settings.excess) * expected
        self._stood = self._stood + 1 if standing else 0
        to_blame = self._rumbling and self._stood > self._settings.settle and not swing <= self._limit
        # a rumble swells and fades: while it fades nothing is counted, and nothing forgotten
        self._rumbled = (self._rumbled + (not dying)) if to_blame else 0
        return self._rumbled >= self._settings.count or self._bursts >= _BURSTS

    def interrupt(self) -> None:
        """Begin to count anew: another height was selected."""
        self._rumbled = self._stood = self._bursts = 0

    def lower(self, height: float, amplitude: float) -> float:
        """Return the height [m] one step below `height`, never below the lowest; remembered for `amplitude` [m]."""
        if not self._remembers(amplitude):
            self._kept = 1.0
        self._amplitude = amplitude
        self._kept *= 1.0 - self._settings.share
        self.interrupt()
        return height - self._settings.share * max(0.0, height - self._lowest)

    def allowed(self, height: float, amplitude: float) -> float:
        """Return what may be had of a height selected for `amplitude` [m]: less, while the step back is remembered."""
        if not self._remembers(amplitude):
            self._amplitude, self._kept = math.nan, 1.0
        return height if self._kept == 1.0 else self._lowest + self._kept * max(0.0, height - self._lowest)

    def _remembers(self, amplitude: float) -> bool:
        return abs(amplitude - self._amplitude) <= self._settings.memory * self._amplitude
