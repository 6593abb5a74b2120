# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The backends for the contract tests: a device, and functions that pull its cable."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from grpc_server import Server

from atpid_driver.acquisition.labjack import LabJackAcquisition
from atpid_driver.acquisition.nidaqmx import NiAcquisition
from atpid_driver.acquisition.protocol import Acquisition, Channel, LabJackSettings, NiSettings, SimulatedSettings
from atpid_driver.acquisition.simulated import SERIAL as SIMULATED_SERIAL
from atpid_driver.acquisition.simulated import Faults, SimulatedAcquisition
from atpid_driver.standins import Control, build
from atpid_driver.standins.device import SERIAL

BACKENDS = ("simulated", "labjack", "nidaqmx", "nidaqmx-grpc")


@dataclass(frozen=True)
class Rig:
    """One backend under test. `make(serial, rate, scans)` gives a fresh, unopened device."""

    make: Callable[..., Acquisition]
    serial: int
    unplug: Callable[[], None]
    replug: Callable[[], None]
    drop: Callable[[int], None] | None
    """None: this device stops rather than report lost scans."""


def channels(first: int, prefix: str, kind: str = "voltage", count: int = 2) -> tuple[Channel, ...]:
    names = ("support_displacement", "beam_displacement", "beam_acceleration")[:count]
    return tuple(Channel(name, f"{prefix}{first + i}", kind) for i, name in enumerate(names))


@contextmanager
def rig(backend: str, folder: Path, environment: pytest.MonkeyPatch) -> Iterator[Rig]:
    """Set the backend up in this process."""
    if backend == "simulated":
        faults = Faults()

        def simulated(serial: int = 0, rate: float = 1000.0, scans: int = 20) -> Acquisition:
            settings = SimulatedSettings(serial=serial, channels=channels(0, "x"), rate=rate, scans_per_block=scans)
            return SimulatedAcquisition(settings, faults)

        def change(name: str, value: Any) -> None:
            setattr(faults, name, value)

        plug, drop = (partial(change, name) for name in ("plugged", "drop"))
        yield Rig(simulated, SIMULATED_SERIAL, partial(plug, False), partial(plug, True), drop)
        return
    name, library = ("LJM", "libLabJackM.so") if backend == "labjack" else ("DAQMX", "libnidaqmx.so")
    environment.setenv(f"ATPID_{name}_CONTROL", str(folder / "control"))
    environment.setenv(f"ATPID_{name}_SOURCE", "sine")
    with closing(Control(folder / "control")) as control, Server(build() / "libnidaqmx.so") as server:

        def vendor(serial: int = 0, rate: float = 1280.0, scans: int = 20) -> Acquisition:
            values: dict[str, Any] = {"serial": serial, "scans_per_block": scans, "library": str(build() / library)}
            if backend == "labjack":
                return LabJackAcquisition(LabJackSettings(channels=channels(0, "AIN"), rate=rate, **values))
            address = server.address if backend == "nidaqmx-grpc" else ""
            return NiAcquisition(NiSettings(channels=channels(0, "ai"), rate=rate, grpc=address, **values))

        lose = control.drop if backend == "labjack" else None
        yield Rig(vendor, SERIAL, control.unplug, control.replug, lose)
