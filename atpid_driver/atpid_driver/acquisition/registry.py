# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Backends by name: those built in, and those that installed distributions declare as entry points of `_GROUP`.

A vendor's package is imported when a device is opened, not before (docs/extend.md).
"""

from collections.abc import Callable
from dataclasses import fields
from importlib.metadata import EntryPoint
from typing import NamedTuple

from atpid_common.entry_points import installed, loaded
from atpid_common.files import Document
from atpid_driver.acquisition.labjack import LabJackAcquisition
from atpid_driver.acquisition.nidaqmx import NiAcquisition
from atpid_driver.acquisition.protocol import (
    Acquisition,
    AcquisitionSettings,
    LabJackSettings,
    NiSettings,
    SetupRefusedError,
    SimulatedSettings,
)
from atpid_driver.acquisition.simulated import SimulatedAcquisition
from atpid_driver.acquisition.topic import TopicAcquisition, TopicSettings

#: Group of the entry points that add backends; the name of an entry point is the name of its backend.
_GROUP = "atpid.acquisition"


class Backend(NamedTuple):
    """What makes a device: the class of its settings, and a function of such settings that returns it unopened."""

    settings: type[AcquisitionSettings]
    make: Callable[..., Acquisition]


BUILT_IN = {
    "labjack": Backend(LabJackSettings, LabJackAcquisition),
    "nidaqmx": Backend(NiSettings, NiAcquisition),
    "simulated": Backend(SimulatedSettings, SimulatedAcquisition),
    "topic": Backend(TopicSettings, TopicAcquisition),
}


def names() -> tuple[str, ...]:
    """Return the names of all backends, those of entry points after the built-in ones; none is imported."""
    return (*BUILT_IN, *_added())


def _added() -> dict[str, EntryPoint]:
    return installed(_GROUP, BUILT_IN, SetupRefusedError)


def backend(name: str) -> Backend:
    """Return a backend. Raises SetupRefusedError: there is none of this name, several, or it cannot be loaded."""
    added = _added()
    if name in BUILT_IN:
        return BUILT_IN[name]
    if name not in added:
        raise SetupRefusedError(f"backend {name!r} is not known: choose one of {', '.join(names())}")
    plug_in = loaded(added[name], error=SetupRefusedError)
    if not isinstance(plug_in, Backend):
        raise SetupRefusedError(
            f"backend {name!r} of {added[name].value} is a {type(plug_in).__name__}: it must be an "
            f"{Backend.__module__}.{Backend.__name__}"
        )
    if "__dataclass_fields__" not in vars(plug_in.settings):
        raise SetupRefusedError(
            f"backend {name!r} of {added[name].value}: {plug_in.settings.__name__} is no dataclass: put "
            "@dataclass(frozen=True, kw_only=True) before it"
        )
    return plug_in


def create(name: str, values: dict[str, object]) -> Acquisition:
    """Return the named backend set up with `values`, keys it does not have left out; SetupRefusedError otherwise."""
    model, make = backend(name)
    known: Document = {one.name: values[one.name] for one in fields(model) if one.name in values}
    return make(model(**known))
