# SPDX-License-Identifier: Apache-2.0
"""What each backend is told, checked before any device is touched."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from atpid_driver.acquisition.errors import SetupRefusedError

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
T7_RANGES = (10.0, 1.0, 0.1, 0.01)
S = TypeVar("S", bound="Settings")


class Channel(BaseModel):
    """One input: its name in the messages and where it is wired."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(min_length=1)]
    terminal: Annotated[str, Field(min_length=1)]
    kind: Literal["voltage", "iepe"] = "voltage"


class Settings(BaseModel):
    """What all backends need: which device (serial 0: any), which channels, how fast [Hz], scans a block."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    serial: Annotated[int, Field(ge=0)] = 0
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]
    rate: Positive
    scans_per_block: Annotated[int, Field(ge=1)]

    @model_validator(mode="after")
    def _names_differ(self) -> Settings:
        names = [channel.name for channel in self.channels]
        if len(set(names)) != len(names):
            raise ValueError(f"channel names {names} are not all different: give each its own")
        return self


class SimulatedSettings(Settings):
    """Sines of one amplitude [V], offset [V] and frequency [Hz], paced like a device."""

    amplitude: float = 1.0
    offset: float = 3.0
    frequency: Positive = 5.0


class LabJackSettings(Settings):
    """A T7 over LJM; `library` is a path to libLabJackM.so where the loader does not find it by name."""

    connection: Literal["ANY", "USB", "TCP", "ETHERNET", "WIFI"] = "ANY"
    voltage_range: Positive = 10.0
    resolution_index: Annotated[int, Field(ge=0, le=8)] = 0
    settling_us: Annotated[float, Field(ge=0.0, le=4400.0)] = 0.0
    library: str = ""

    @field_validator("voltage_range")
    @classmethod
    def _has_range(cls, volts: float) -> float:
        if volts not in T7_RANGES:
            raise ValueError(f"a T7 has the ranges {', '.join(f'{one:g}' for one in T7_RANGES)} V")
        return volts


class NiSettings(Settings):
    """An NI-9230 through NI-DAQmx here, or on another PC through NI's gRPC device server at `grpc` ("host:port")."""

    device: Annotated[str, Field(min_length=1)] = "cDAQ1Mod1"
    voltage_range: Positive = 30.0
    excitation_current: Annotated[float, Field(ge=0.0, le=0.02)] = 0.004
    library: str = ""
    grpc: str = ""


def checked(model: type[S], values: dict[str, object]) -> S:
    """Return settings made of `values`; SetupRefusedError says in one line what was given and what is allowed."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "settings"
        raise SetupRefusedError(f"{key} = {first['input']!r} is refused: {first['msg']}") from None
