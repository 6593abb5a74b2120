# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The backends for the contract tests: a device, and what happens to it."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from grpc_server import Server

from atpid_driver.acquisition import simulated
from atpid_driver.acquisition.labjack import LabJackAcquisition
from atpid_driver.acquisition.nidaqmx import NiAcquisition
from atpid_driver.acquisition.protocol import Acquisition, Channel, LabJackSettings, NiSettings, SimulatedSettings
from atpid_driver.standins import Control, build
from atpid_driver.standins.device import SERIAL

BACKENDS = ("simulated", "labjack", "nidaqmx", "nidaqmx-grpc")


@dataclass(frozen=True)
class Rig:
    """One backend under test. `make(serial)` gives a fresh, unopened device; nothing happens to a simulated one."""

    make: Callable[..., Acquisition]
    serial: int
    control: Control


def channels(first: int, prefix: str, kind: Any = "voltage", count: int = 2) -> tuple[Channel, ...]:
    names = ("support_displacement", "beam_displacement", "beam_acceleration")[:count]
    return tuple(Channel(name, f"{prefix}{first + i}", kind) for i, name in enumerate(names))


@contextmanager
def rig(backend: str, folder: Path, environment: pytest.MonkeyPatch) -> Iterator[Rig]:
    name, library = ("LJM", "libLabJackM.so") if backend == "labjack" else ("DAQMX", "libnidaqmx.so")
    environment.setenv(f"ATPID_{name}_CONTROL", str(folder / "control"))
    environment.setenv(f"ATPID_{name}_SOURCE", "sine")
    with closing(Control(folder / "control")) as control, Server(build() / "libnidaqmx.so") as server:

        def make(serial: int = 0) -> Acquisition:
            values: dict[str, Any] = {"serial": serial, "rate": 1280.0, "scans_per_block": 20}
            if backend == "simulated":
                return simulated.SimulatedAcquisition(SimulatedSettings(channels=channels(0, "x"), **values))
            values["library"] = str(build() / library)
            if backend == "labjack":
                return LabJackAcquisition(LabJackSettings(channels=channels(0, "AIN"), **values))
            address = server.address if backend == "nidaqmx-grpc" else ""
            return NiAcquisition(NiSettings(channels=channels(0, "ai"), grpc=address, **values))

        yield Rig(make, simulated.SERIAL if backend == "simulated" else SERIAL, control)
