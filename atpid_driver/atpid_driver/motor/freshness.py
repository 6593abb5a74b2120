# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How old a command is, by the steady clock: the clock of the wall may be set while a node is suspended."""

#: The least lateness seen is forgotten by so much a second, so that a clock that drifts is followed [-].
_LEAK = 0.01
_NANO = 1e-9


class Freshness:
    """The ages of the commands of one loop, from their stamps. Times are steady, stamps of any clock [ns]."""

    def __init__(self) -> None:
        self._armed = 0
        self._last: tuple[int, int] | None = None  # stamp and receipt of the newest command
        self._least = 0  # receipt minus stamp, where it was least

    def restart(self) -> None:
        """A source begins: its stamps are not those of the one before."""
        self._last = None

    def armed(self, now: int) -> None:
        """Note that the motor was armed at `now`: what was commanded before must not move it."""
        self._armed = now

    def age(self, stamp: int, now: int) -> float:
        """Return by how much a command with `stamp` comes later than the loop's usual delay [s].

        A stamp that is repeated shows nothing, one that goes back begins anew: 0.
        """
        offset = now - stamp
        if self._last is None or stamp < self._last[0]:
            self._last, self._least = (stamp, now), offset
        if stamp > self._last[0]:
            leaked = round(_LEAK * (now - self._last[1]))
            self._least = min(offset, self._least + leaked)
            self._last = stamp, now
            return (offset - self._least) * _NANO
        return 0.0

    def before_armed(self, age: float, now: int) -> bool:
        """Whether a command of this age [s] was made before the motor was armed."""
        return age * 1e9 > now - self._armed
