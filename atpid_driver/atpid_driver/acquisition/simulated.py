# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A simulated device: sines on every channel, with injectable faults."""

import threading
import time
from dataclasses import dataclass

import numpy as np

from atpid_driver.acquisition.protocol import (
    Device,
    DeviceIdentity,
    DeviceMissingError,
    SimulatedSettings,
    StreamLostError,
    Volts,
)

SERIAL = 1


@dataclass
class Faults:
    """Faults injected into the simulated device. Set the fields from any thread."""

    plugged: bool = True
    serial: int = SERIAL
    drop: int = 0  # scans to lose from the next block on


class SimulatedAcquisition(Device):
    """Sines on every channel, an eighth of a turn apart, paced by the steady clock."""

    def __init__(self, settings: SimulatedSettings, faults: Faults | None = None) -> None:
        self._settings: SimulatedSettings = settings
        self.faults = faults if faults is not None else Faults()
        self._began = 0.0  # steady clock at index 0 [s]
        self._pause = threading.Event()

    def open(self) -> DeviceIdentity:
        """Return the identity if plugged in."""
        if not self.faults.plugged:
            raise DeviceMissingError("simulated device not found: plug it in")
        self._check_serial("simulated device has", self.faults.serial)
        return DeviceIdentity("simulated", self.faults.serial)

    def start(self) -> float:
        """Start at index 0; any rate is exact."""
        if not self.faults.plugged:
            raise StreamLostError("simulated device was unplugged")
        self._began = time.monotonic()
        return self._started(self._settings.rate)

    def _take(self) -> tuple[Volts, int]:
        """Wait until the last scan is due."""
        settings, first = self._settings, self._next
        last = first + settings.scans_per_block
        self._pause.wait(max(0.0, self._began + last / settings.rate - time.monotonic()))
        if not self.faults.plugged:
            raise StreamLostError("simulated device was unplugged")
        time_s = np.arange(first, last)[:, None] / settings.rate
        phase = np.arange(len(settings.channels)) * np.pi / 4.0
        volts = settings.offset + settings.amplitude * np.sin(2.0 * np.pi * settings.frequency * time_s + phase)
        lost = min(self.faults.drop, len(volts))
        volts[:lost] = np.nan
        self.faults.drop -= lost
        self._dropped += lost
        due = int((time.monotonic() - self._began) * settings.rate)
        return volts, max(0, due - last)

    def stop(self) -> None:
        """Stop."""
        self._rate = None

    def close(self) -> None:
        """Close; there is nothing to release."""
        self._rate = None
