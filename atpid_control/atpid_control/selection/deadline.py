# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The time a selection has: runs are begun only while there is enough of it left for one."""

import math
import time
from collections.abc import Callable, Iterable
from typing import Any

from atpid_control.selection.protocol import SelectionError
from atpid_sim.maps.ratings import Mapper


class OutOfTimeError(Exception):
    """A computation was ended, since its share of the time had passed."""


class Deadline:
    """A time from now on."""

    def __init__(self, seconds: float) -> None:
        """Take the time [s]; math.inf: there is no deadline. Raises SelectionError for an invalid one."""
        if not seconds > 0.0:
            raise SelectionError(f"deadline: given {seconds:g} s; allowed is a time above 0 s")
        self.seconds, self._begun = seconds, time.monotonic()
        self._asked = self._longest = 0.0  # when it was asked for last, and the longest time between two questions [s]

    @property
    def spent(self) -> float:
        """Time since the beginning [s]."""
        return time.monotonic() - self._begun

    def passed(self, share: float = 1.0) -> bool:
        """Whether a share of the time has passed."""
        return self.spent > share * self.seconds

    def near(self, share: float) -> bool:
        """Whether a share of the time will have passed after one more step, asked before every step.

        A step is taken to last as long as the longest so far: on a busy machine most of it is waiting for a processor.
        """
        now = self.spent
        self._longest, self._asked = max(self._longest, now - self._asked), now
        return now + self._longest > share * self.seconds

    def limited(self, mapper: Mapper, share: float) -> Mapper:
        """Return a mapper that raises OutOfTimeError in place of the first job near a share of the time."""
        if math.isinf(self.seconds):
            return mapper

        def limited_mapper(work: Callable[[Any], Any], jobs: Iterable[Any]) -> Iterable[Any]:
            def in_time(job: Any) -> Any:
                if self.near(share):
                    raise OutOfTimeError
                return work(job)

            return mapper(in_time, jobs)

        return limited_mapper
