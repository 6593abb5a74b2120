# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The backends for the contract tests: a device, and functions that pull its cable."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from grpc_server import Server

from atpid_driver.acquisition.labjack import LabJackAcquisition
from atpid_driver.acquisition.nidaqmx import NiAcquisition
from atpid_driver.acquisition.protocol import Acquisition
from atpid_driver.acquisition.settings import Channel, LabJackSettings, NiSettings, SimulatedSettings
from atpid_driver.acquisition.simulated import SERIAL as SIMULATED_SERIAL
from atpid_driver.acquisition.simulated import Faults, SimulatedAcquisition
from atpid_driver.standins import Control, build
from atpid_driver.standins.control import SERIAL

BACKENDS = ("simulated", "labjack", "nidaqmx", "nidaqmx-grpc")


@dataclass(frozen=True)
class Rig:
    """One backend under test. `make(serial, rate, scans)` gives a fresh, unopened device."""

    make: Callable[..., Acquisition]
    serial: int
    unplug: Callable[[], None]
    replug: Callable[[], None]
    swap: Callable[[int], None]
    drop: Callable[[int], None] | None
    """None: this device stops rather than report lost scans."""
    refused_rate: float
    """A rate that is not exactly possible, 0 where every rate is."""


def channels(first: int, prefix: str, kind: str = "voltage", count: int = 2) -> tuple[Channel, ...]:
    names = ("support_displacement", "beam_displacement", "beam_acceleration")[:count]
    return tuple(
        Channel.model_validate({"name": name, "terminal": f"{prefix}{first + i}", "kind": kind})
        for i, name in enumerate(names)
    )


@contextmanager
def rig(backend: str, folder: Path, environment: pytest.MonkeyPatch) -> Iterator[Rig]:
    """Set the backend up in this process."""
    if backend == "simulated":
        yield _simulated()
        return
    libraries = build()
    control = Control(folder / "control")
    name = "LJM" if backend == "labjack" else "DAQMX"
    environment.setenv(f"ATPID_{name}_CONTROL", str(control.path))
    environment.setenv(f"ATPID_{name}_SOURCE", "sine")
    if backend == "labjack":
        yield _vendor(control, lambda **kw: _labjack(libraries, **kw), 999.97, with_drop=True)
    elif backend == "nidaqmx":
        yield _vendor(control, lambda **kw: _ni(libraries, "", **kw), 1000.0, with_drop=False)
    else:
        with Server(libraries / "libnidaqmx.so") as server:
            yield _vendor(control, lambda **kw: _ni(libraries, server.address, **kw), 1000.0, with_drop=False)
    control.close()


def _simulated() -> Rig:
    faults = Faults()

    def make(serial: int = 0, rate: float = 1000.0, scans: int = 20) -> Acquisition:
        settings = SimulatedSettings(serial=serial, channels=channels(0, "x"), rate=rate, scans_per_block=scans)
        return SimulatedAcquisition(settings, faults)

    def plug(plugged: bool) -> None:
        faults.plugged = plugged

    def drop(scans: int) -> None:
        faults.drop += scans

    def swap(serial: int) -> None:
        faults.serial = serial

    return Rig(make, SIMULATED_SERIAL, lambda: plug(False), lambda: plug(True), swap, drop, 0.0)


def _vendor(control: Control, make: Callable[..., Acquisition], refused: float, *, with_drop: bool) -> Rig:
    return Rig(
        make, SERIAL, control.unplug, control.replug, control.serial, control.drop if with_drop else None, refused
    )


def _labjack(libraries: Path, serial: int = 0, rate: float = 1000.0, scans: int = 20) -> Acquisition:
    library = str(libraries / "libLabJackM.so")
    return LabJackAcquisition(
        LabJackSettings(serial=serial, channels=channels(0, "AIN"), rate=rate, scans_per_block=scans, library=library)
    )


def _ni(libraries: Path, grpc: str, serial: int = 0, rate: float = 1280.0, scans: int = 20) -> Acquisition:
    library = str(libraries / "libnidaqmx.so")
    return NiAcquisition(
        NiSettings(
            serial=serial, channels=channels(0, "ai"), rate=rate, scans_per_block=scans, library=library, grpc=grpc
        )
    )
