# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Out of a rumble: when the height is its cause, how far the ceiling steps back, and that it does not return."""

import math
from collections import deque
from dataclasses import dataclass

from atpid_common.vocabulary import EventKind
from atpid_control.loop.hold import HoldError

#: An amplitude below this share of the one before the span, so many values, is decaying.
DECAY, DECAY_SPAN = 0.97, 8
#: So many bursts of rumble with the ceiling standing count as one rumble, however short each is.
_BURSTS = 2


@dataclass(frozen=True)
class StepBack:
    """Settings of the step back; the parameter file has the values."""

    share: float  # of the clearance above the lowest height given up each time [-]
    settle: int  # estimates after the ceiling has come to rest in which rumble is ignored
    count: int  # estimates that rumble after that, fading ones left out, before each step
    excess: float  # amplitude of the beam above the predicted that is more than inaccuracy [-]
    memory: float  # change of the excitation's amplitude over which a step back applies [-]

    def __post_init__(self) -> None:
        """Raise HoldError for an impossible step."""
        if not 0.0 < self.share < 1.0:
            raise HoldError(f"step_back: given {self.share}; allowed: above 0 and below 1")
        if self.count < 1 or self.settle < 0:
            given = f"{self.count} and {self.settle}"
            raise HoldError(f"rumble_count and settle_count: given {given}; allowed: at least 1 and at least 0")
        for name, given_value in (("step_back_excess", self.excess), ("step_back_memory", self.memory)):
            if not given_value >= 0.0:
                raise HoldError(f"{name}: given {given_value}; allowed: at least 0")


class StepBackMonitor:
    """Decides when one ceiling steps back and by how much, and limits later selections."""

    def __init__(self, settings: StepBack, lowest: float) -> None:
        """Take the settings and the lowest height of the ceiling [m]."""
        self.settings = settings  # may be replaced: they hold from the next estimate on
        self._lowest = lowest
        self._rumbling = False
        self._rumbled = 0  # estimates in rumble that the height causes
        self._stood = 0  # consecutive estimates with the ceiling where it was sent
        self._bursts = 0  # rumbles that began with the ceiling standing and the beam too large
        self._limit = math.nan  # amplitude of the beam from which it is too large [m], NaN: any
        self._amplitudes: deque[float] = deque(maxlen=DECAY_SPAN)  # the beam's latest amplitudes [m]
        self._stepped_at = math.nan  # excitation amplitude of the last step back [m]
        self._kept = 1.0  # share of the selected clearance that was left then [-]

    @property
    def settled(self) -> bool:
        """Whether the ceiling has stood for the settling time and the beam is regular."""
        return self._stood > self.settings.settle and not self._rumbling

    def on_event(self, kind: str) -> None:
        """Take an event: `rumble`, or `calm` when that has ended."""
        if kind not in (EventKind.RUMBLE, EventKind.CALM):
            return
        self._rumbling = kind == EventKind.RUMBLE
        if self._rumbling and self._stood > self.settings.settle and self._amplitudes:
            # a burst is detected near its end: its size shows in the amplitudes before
            self._bursts += not max(self._amplitudes) <= self._limit

    def watch(self, amplitude: float, expected: float, standing: bool) -> bool:
        """Take one more estimate; return whether it is time for a step.

        amplitude, expected: of the beam, measured and predicted [m], NaN: unknown; standing: the ceiling is where it
        was sent. The height is the cause where the ceiling stands and the beam rumbles, too large, without decaying:
        while the ceiling moves, and while a larger motion decays, the response is irregular at any height.
        """
        self._amplitudes.append(amplitude)
        decaying = len(self._amplitudes) == DECAY_SPAN and amplitude < DECAY * self._amplitudes[0]
        self._limit = (1.0 + self.settings.excess) * expected
        self._stood = self._stood + 1 if standing else 0
        caused = self._rumbling and self._stood > self.settings.settle and not amplitude <= self._limit
        # a rumble swells and fades: while it fades the count is held
        self._rumbled = (self._rumbled + (not decaying)) if caused else 0
        return self._rumbled >= self.settings.count or self._bursts >= _BURSTS

    def interrupt(self) -> None:
        """Restart the counts: another height was selected."""
        self._rumbled = self._stood = self._bursts = 0

    def lower(self, height: float, amplitude: float) -> float:
        """Return the height [m] a step below `height`, at least the lowest; it applies to `amplitude` [m]."""
        if not self._applies(amplitude):
            self._kept = 1.0
        self._stepped_at = amplitude
        self._kept *= 1.0 - self.settings.share
        self.interrupt()
        return height - self.settings.share * max(0.0, height - self._lowest)

    def allowed(self, height: float, amplitude: float) -> float:
        """Return the height [m] allowed where `height` is selected for `amplitude` [m]: lower after a step back."""
        if not self._applies(amplitude):
            self._stepped_at, self._kept = math.nan, 1.0
        return height if self._kept == 1.0 else self._lowest + self._kept * max(0.0, height - self._lowest)

    def _applies(self, amplitude: float) -> bool:
        return abs(amplitude - self._stepped_at) <= self.settings.memory * self._stepped_at
