# SPDX-License-Identifier: Apache-2.0
"""Whether the excitation is still the one last reported steady."""

from __future__ import annotations

import math

from atpid_control.identification.estimate import Quality

#: Steady estimates differ by noise alone up to this many of their standard deviations.
SIGMAS = 6.0
#: A share of `change` this small in frequency counts as one: heights depend on it much more than on amplitude.
FREQUENCY_SHARE = 0.5


class ChangeTracker:
    """Compares each estimate with the first steady one since the last change.

    `changed` stays true from the first sign of a change up to and including the steady estimate that ends it. The first
    steady estimate of all is a change too: from nothing.
    """

    def __init__(self, change: float) -> None:
        """Take the relative change of amplitude that counts [-]."""
        self._change = change
        self._reference: tuple[float, float, float, float] | None = None
        self._pending = False

    def configure(self, change: float) -> None:
        """Compare by another relative change [-] from the next estimate on."""
        self._change = change

    def judge(
        self, quality: Quality, amplitude: float, amplitude_std: float, frequency: float, frequency_std: float
    ) -> bool:
        """Return whether a change was seen, this estimate included; [m], [m], [Hz], [Hz]."""
        if quality == Quality.POOR:
            return self._pending
        if quality != Quality.STEADY:
            self._pending = self._pending or quality == Quality.TRANSIENT or self._reference is not None
            return self._pending
        newest = (amplitude, amplitude_std, frequency, frequency_std)
        seen = self._pending or self._reference is None or self._differs(self._reference, newest)
        if seen:
            self._reference = newest
        self._pending = False
        return seen

    def _differs(self, old: tuple[float, float, float, float], new: tuple[float, float, float, float]) -> bool:
        amplitude = max(self._change * old[0], SIGMAS * math.hypot(old[1], new[1]))
        frequency = max(FREQUENCY_SHARE * self._change * old[2], SIGMAS * math.hypot(old[3], new[3]))
        return abs(new[0] - old[0]) > amplitude or abs(new[2] - old[2]) > frequency
