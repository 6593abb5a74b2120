# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Warning and abort level of each quantity. A warning is given once, until the quantity has been lower for a while.

An abort is latched: whatever the quantity does then, it stays until a person has re-armed. At the end the supervisor's
parameters, these levels among them.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from atpid_common.parameters import Entry
from atpid_control.supervision.states import SupervisionError

#: What may be limited, and its unit. Those with the name of a channel are read from the sensors' blocks.
QUANTITIES: Mapping[str, str] = {
    "support_displacement": "m",
    "drive_force": "N",
    "beam_displacement": "m",
    "beam_acceleration": "m/s^2",
    "temperature": "degC",
    "contact_rate": "1/s",
    "motor_on_time": "s",
}
#: A warning is given again after the quantity has been below its level for so long [s].
_QUIET = 1.0


class PassedLevel(Enum):
    """Which level was passed."""

    WARNING = "warning"
    ABORT = "abort"


@dataclass(frozen=True)
class Levels:
    """Warning and abort level of the magnitude of a quantity, in its unit; infinity: none."""

    warning: float = math.inf
    abort: float = math.inf


@dataclass(frozen=True)
class Passed:
    """A quantity has passed a level."""

    name: str
    severity: PassedLevel
    value: float
    level: float

    def __str__(self) -> str:
        unit = QUANTITIES[self.name]
        return f"{self.name} {self.value:.4g} {unit} is above its {self.severity.value} level {self.level:g} {unit}"


class AbortLevels:
    """The levels of all quantities, and which were passed. Times are steady [s]."""

    def __init__(self, levels: Mapping[str, Levels]) -> None:
        """Begin with nothing passed. Raises SupervisionError for an unknown quantity or an impossible level."""
        for name, level in levels.items():
            if name not in QUANTITIES:
                raise SupervisionError(f"limit of {name}: given this name; allowed: {', '.join(QUANTITIES)}")
            # written so that NaN is refused as well
            if not level.warning > 0.0 or not level.abort > 0.0:
                given = f"warning {level.warning:g} and abort {level.abort:g} {QUANTITIES[name]}"
                raise SupervisionError(f"limit of {name}: given {given}; allowed: above 0; .inf: none")
            if level.abort < math.inf and level.abort < level.warning < math.inf:
                given = f"warning {level.warning:g} above abort {level.abort:g} {QUANTITIES[name]}"
                raise SupervisionError(f"limit of {name}: given {given}; allowed: the warning level below the other")
        self.levels = dict(levels)
        self._above: dict[str, float] = {}  # when the warning level was last exceeded [s]
        self.aborted: dict[str, Passed] = {}

    def limited(self, name: str) -> bool:
        """Whether a quantity has a level at all."""
        level = self.levels.get(name, Levels())
        return min(level.warning, level.abort) < math.inf

    def update(self, name: str, value: float, now: float) -> Passed | None:
        """Take a value; return the level that it passes now, None for none. NaN, which is no value, passes none."""
        level, magnitude = self.levels.get(name, Levels()), abs(value)
        if magnitude > level.abort and name not in self.aborted:
            self.aborted[name] = Passed(name, PassedLevel.ABORT, magnitude, level.abort)
            self._above[name] = now
            return self.aborted[name]
        if magnitude > level.warning:
            last, self._above[name] = self._above.get(name, -math.inf), now
            if now - last > _QUIET and name not in self.aborted:
                return Passed(name, PassedLevel.WARNING, magnitude, level.warning)
        return None

    def still_above(self, latest: Mapping[str, float]) -> tuple[str, ...]:
        """Return the aborted quantities whose latest magnitude is above the abort level still."""
        return tuple(name for name in self.aborted if abs(latest.get(name, 0.0)) > self.levels[name].abort)

    def rearm(self) -> None:
        """Clear all aborts."""
        self.aborted.clear()


#: Displacements change smoothly: a level counts as passed when so many samples in a row are beyond it, no lone spike.
SUSTAINED = 3
#: Contacts are counted over so long [s].
_COUNTED = 1.0


def sustained(values: NDArray[np.float64], samples: int = SUSTAINED) -> float:
    """Return the largest magnitude that `samples` values (n,) in a row reach; NaN where there are not so many."""
    magnitude = np.abs(values)
    if len(magnitude) < samples:
        return math.nan
    windows = np.lib.stride_tricks.sliding_window_view(magnitude, samples)
    # a window with a sample that is no number is none
    lowest = windows.min(axis=1)
    return float(np.max(lowest, initial=-math.inf, where=~np.isnan(lowest))) if not np.isnan(lowest).all() else math.nan


def largest(values: NDArray[np.float64]) -> float:
    """Return the largest magnitude of values (n,); NaN where there is none. An impact may last one sample."""
    magnitude = np.abs(values[~np.isnan(values)])
    return float(magnitude.max()) if len(magnitude) else math.nan


class ContactRate:
    """Contacts a second: pulses of the acceleration above a threshold, further apart than the dead time."""

    def __init__(self, threshold: float, dead_time: float) -> None:
        """Count none yet. threshold: of the magnitude [m/s^2]; dead_time: a pulse within it is the same contact [s]."""
        self._threshold, self._dead_time = threshold, dead_time
        self._contacts: deque[float] = deque()
        self._last_above = -math.inf

    def push(self, first_index: int, rate: float, acceleration: NDArray[np.float64]) -> float:
        """Take samples (n,) [m/s^2] from index `first_index` at `rate` [Hz]; return the contacts a second [1/s]."""
        for offset in np.flatnonzero(np.abs(acceleration) > self._threshold):
            time = (first_index + int(offset)) / rate
            if time - self._last_above > self._dead_time:
                self._contacts.append(time)
            self._last_above = time
        end = (first_index + len(acceleration)) / rate
        while self._contacts and self._contacts[0] < end - _COUNTED:
            self._contacts.popleft()
        return len(self._contacts) / _COUNTED


class OnTime:
    """How long the motor's current has been on without interruption [s]."""

    def __init__(self) -> None:
        self._since: float | None = None

    def push(self, on: bool, now: float) -> float:
        """Take whether it is on at the steady time `now` [s]; return for how long [s]."""
        if not on:
            self._since = None
            return 0.0
        self._since = now if self._since is None else self._since
        return now - self._since


_NODES = ["identifier_node", "selector_node", "motor_node", "recorder_node"]
_NEEDED = ["identifier_node", "selector_node", "recorder_node"]
SUPERVISOR = (
    Entry("nodes", _NODES, "nodes that have to answer; the bench and the stand add the sources"),
    Entry("needed", _NEEDED, "those without whose answers the ceiling is held and the motor gets no heartbeat"),
    Entry("scene", "", "scene file, whose ceiling's limits the loop check compares; empty: they are not"),
    Entry("check_time", 5.0, "time from the first sample until the loop check has to pass; 0: none", "s", 0.0, 3600.0),
    Entry("answer_time", 0.4, "silence after which a node is named", "s", 0.15, 10.0),
    Entry("give_up", 10.0, "silence of a needed node after which the run ends; 0: never", "s", 0.0, 3600.0),
    Entry(
        "restart_time", 0.0, "time for one that has ended to come back; 0: it is not started again", "s", 0.0, 3600.0
    ),
    *(
        Entry(f"{name}_{level}", math.inf, f"{level} level of its magnitude; .inf: none [{unit}]")
        for name, unit in QUANTITIES.items()
        for level in ("warning", "abort")
    ),
    Entry("contact_acceleration", 50.0, "a pulse of beam_acceleration above it is a contact", "m/s^2", 0.0, 1e6),
    Entry("contact_dead_time", 0.005, "a pulse this soon after the last one is the same contact", "s", 0.0, 1.0),
)
