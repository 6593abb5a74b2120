# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Percentiles of the latest latencies."""

import math
from collections import deque
from collections.abc import Iterable

#: Latencies kept: a minute of blocks at 20 a second.
COUNT = 1200
#: A stamp further off than this is of another clock than the machine's: a replayed bag [s].
ANOTHER_CLOCK = 60.0


def percentile(values: Iterable[float], share: float) -> float:
    """Return the smallest value that at least `share` [-] of the values do not exceed; NaN where there is none."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)] if ordered else math.nan


class Latencies:
    """The latest latencies of one stage of the loop [s]."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=COUNT)

    def add(self, nanoseconds: int) -> None:
        """Take one latency [ns]."""
        if abs(nanoseconds) < ANOTHER_CLOCK * 1e9:
            self._values.append(nanoseconds * 1e-9)

    def values(self, stage: str) -> dict[str, str]:
        """Return median, 99th percentile and maximum in milliseconds, as diagnostics show them."""
        shown = {"p50": percentile(self._values, 0.5), "p99": percentile(self._values, 0.99)}
        shown["max"] = max(self._values, default=math.nan)
        return {f"{stage} {name} [ms]": f"{1e3 * value:.1f}" for name, value in shown.items()}
