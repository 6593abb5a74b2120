# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A simulated device: sines on every channel."""

import time

import numpy as np

from atpid_driver.acquisition.protocol import Device, DeviceIdentity, SimulatedSettings, Volts

SERIAL = 1


class SimulatedAcquisition(Device[SimulatedSettings]):
    """Sines on every channel, an eighth of a turn apart, paced by the steady clock."""

    _began = 0.0  # steady clock at index 0 [s]

    def open(self) -> DeviceIdentity:
        """Return the identity."""
        self._check_serial("simulated device has", SERIAL)
        return DeviceIdentity("simulated", SERIAL)

    def start(self) -> float:
        """Start at index 0; any rate is exact."""
        self._began = time.monotonic()
        return self._started(self._settings.rate)

    def _take(self) -> tuple[Volts, int]:
        settings, first = self._settings, self._next
        last = first + settings.scans_per_block
        time.sleep(max(0.0, self._began + last / settings.rate - time.monotonic()))
        time_s = np.arange(first, last)[:, None] / settings.rate
        phase = np.arange(len(settings.channels)) * np.pi / 4.0
        volts = settings.offset + settings.amplitude * np.sin(2.0 * np.pi * settings.frequency * time_s + phase)
        due = int((time.monotonic() - self._began) * settings.rate)
        return volts, max(0, due - last)

    def stop(self) -> None:
        """Stop."""
        self._rate = None

    def close(self) -> None:
        """Close; there is nothing to release."""
        self._rate = None
