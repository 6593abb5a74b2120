# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The limited quantities as the graph's messages give them."""

from collections.abc import Callable

import numpy as np
from atpid_interfaces.msg import SampleBlock

from atpid_control.supervision.limits import AbortLevels, ContactRate, OnTime, Passed, largest, sustained

#: Channels that change smoothly, so that a lone sample beyond a level is a spike of the sensor.
SMOOTH = ("support_displacement", "drive_force", "beam_displacement", "temperature")
ACCELERATION = "beam_acceleration"


class QuantityWatch:
    """Compares the quantities of blocks and motor states with their levels."""

    def __init__(self, limits: AbortLevels, contact: tuple[float, float], on_passed: Callable[[Passed], None]) -> None:
        """Take the levels; contact: threshold [m/s^2] and dead time [s]; on_passed: called with each level passed."""
        self._limits, self._on_passed = limits, on_passed
        self._contacts, self._on_time = ContactRate(*contact), OnTime()
        self._latest: dict[str, float] = {}

    def on_block(self, block: SampleBlock, now: float) -> None:
        """Take a block of samples received at the steady time `now` [s]."""
        names = list(block.channels)
        data = np.frombuffer(block.data, dtype=np.float64).reshape(-1, len(names))
        for column, name in enumerate(names):
            values = data[:, column]
            if self._limits.limited(name):
                self._take(name, sustained(values) if name in SMOOTH else largest(values), now)
            if name == ACCELERATION and self._limits.limited("contact_rate"):
                self._take("contact_rate", self._contacts.push(block.first_index, block.rate, values), now)

    def on_motor(self, on: bool, now: float) -> None:
        """Take whether the motor's current is on at the steady time `now` [s]."""
        self._take("motor_on_time", self._on_time.push(on, now), now)

    def still_above(self) -> tuple[str, ...]:
        """Return the aborted quantities that are above their abort level still."""
        return self._limits.still_above(self._latest)

    def rearm(self) -> None:
        """Clear all aborts."""
        self._limits.rearm()

    def values(self) -> dict[str, object]:
        """Return the latest of each quantity that is limited, for diagnostics."""
        return {name: f"{value:.4g}" for name, value in self._latest.items()}

    def _take(self, name: str, value: float, now: float) -> None:
        self._latest[name] = value
        passed = self._limits.update(name, value, now)
        if passed is not None:
            self._on_passed(passed)
