# SPDX-License-Identifier: Apache-2.0
"""Backends by name. Vendors' packages are imported when their backend is asked for, not before."""

from __future__ import annotations

from collections.abc import Callable

from atpid_driver.acquisition.errors import SetupRefusedError
from atpid_driver.acquisition.protocol import Acquisition
from atpid_driver.acquisition.settings import LabJackSettings, NiSettings, Settings, SimulatedSettings, checked


def _simulated(settings: Settings) -> Acquisition:
    from atpid_driver.acquisition.simulated import SimulatedAcquisition

    assert isinstance(settings, SimulatedSettings)
    return SimulatedAcquisition(settings)


def _labjack(settings: Settings) -> Acquisition:
    from atpid_driver.acquisition.labjack import LabJackAcquisition

    assert isinstance(settings, LabJackSettings)
    return LabJackAcquisition(settings)


def _nidaqmx(settings: Settings) -> Acquisition:
    from atpid_driver.acquisition.nidaqmx import NiAcquisition

    assert isinstance(settings, NiSettings)
    return NiAcquisition(settings)


BACKENDS: dict[str, tuple[type[Settings], Callable[[Settings], Acquisition]]] = {
    "simulated": (SimulatedSettings, _simulated),
    "labjack": (LabJackSettings, _labjack),
    "nidaqmx": (NiSettings, _nidaqmx),
}


def create(backend: str, values: dict[str, object]) -> Acquisition:
    """Return the named backend set up with `values`, keys it does not know left out; SetupRefusedError otherwise."""
    if backend not in BACKENDS:
        raise SetupRefusedError(f"backend {backend!r} is not known: choose one of {', '.join(sorted(BACKENDS))}")
    model, make = BACKENDS[backend]
    known = {key: value for key, value in values.items() if key in model.model_fields}
    return make(checked(model, known))
