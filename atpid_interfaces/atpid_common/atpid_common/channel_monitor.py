# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The state of a channel of samples, followed block by block; what can be wrong is judged where the signal is known.

The driver judges voltages by their calibration, the identifier the quantities that arrive. Time is counted in scans.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

B = TypeVar("B")


class ChannelState(Enum):
    """States of a channel; the value is what messages call it."""

    PLAUSIBLE = "plausible"
    SPIKES = "spikes"
    CLIPPED = "clipped"
    INTERMITTENT = "intermittent"
    FROZEN = "frozen"
    IMPOSSIBLE = "impossible readings"
    MISSING = "no readings"
    INVALID = "no valid readings"
    OUT_OF_RANGE = "out of range"
    BROKEN_LOOP = "current loop broken"

    @property
    def severity(self) -> int:
        """0: nothing is wrong; 1: readings are missing or doubtful; 2: the sensor does not measure."""
        return {ChannelState.PLAUSIBLE: 0, ChannelState.SPIKES: 1, ChannelState.CLIPPED: 1}.get(self, 2)


@dataclass(frozen=True)
class Finding:
    """A state and what was seen, in one line."""

    state: ChannelState = ChannelState.PLAUSIBLE
    text: str = "plausible"


class ChannelMonitor(Generic[B]):
    """Follows one channel: a worse state holds at once, a better one when it has lasted: a loose contact is one event.

    B: what a subclass keeps of each block.
    """

    def __init__(self) -> None:
        self.finding = Finding()
        self._rate = np.nan  # [Hz]
        self._blocks: deque[tuple[int, B]] = deque()  # of the last window: scans, and what is kept of them
        self._unusable = self._better = 0  # scans without a usable reading; scans in a better state than reported

    def _begin(self, rate: float) -> bool:
        """Forget the blocks of another `rate` [Hz]; return whether it is another one."""
        changed, self._rate = rate != self._rate, rate
        if changed:
            self._blocks.clear()
        return changed

    def _count_unusable(self, usable: NDArray[np.bool_]) -> None:
        """Take which readings (n,) of a block can be used."""
        places = np.flatnonzero(usable)
        self._unusable = usable.size - 1 - int(places[-1]) if places.size else self._unusable + usable.size

    def _keep(self, scans: int, block: B, window: float) -> bool:
        """Keep a block, forget those from before `window` [s]; return whether that has passed."""
        self._blocks.append((scans, block))
        total = self._scans
        while total - self._blocks[0][0] >= window * self._rate:
            total -= self._blocks.popleft()[0]
        return total >= window * self._rate

    @property
    def _scans(self) -> int:
        return sum(scans for scans, _ in self._blocks)

    def _settle(self, found: Finding, scans: int, recovery_time: float) -> Finding | None:
        """Take what a block of `scans` shows; return a change of state, else None.

        recovery_time: how long a better state lasts until it holds [s].
        """
        changed = found.state is not self.finding.state
        self._better = self._better + scans if found.state.severity < self.finding.state.severity else 0
        if changed and self._better and self._better < recovery_time * self._rate:
            return None
        self.finding, self._better = found, 0
        return found if changed else None
