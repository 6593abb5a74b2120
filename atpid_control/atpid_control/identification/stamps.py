# SPDX-License-Identifier: Apache-2.0
"""The instant an estimate stands for: that of the last scan of its block."""

from __future__ import annotations

from atpid_sim.plant.stream import stamp_ns


def last_stamp_ns(begin_ns: int, first_index: int, scans: int, rate: float) -> int:
    """Return when a block's last scan was taken [ns]: the stream's start plus index over rate, rounded once.

    begin_ns: stamp of its first scan; first_index: of that scan; scans: how many it has; rate [Hz].
    """
    if scans == 0 or not rate > 0.0:
        return begin_ns
    start = begin_ns - stamp_ns(0, first_index, rate)
    return stamp_ns(start, first_index + scans - 1, rate)
