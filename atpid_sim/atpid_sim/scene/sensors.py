# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sensors, recording, and faults injected on purpose: only what a run on the bench needs."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from atpid_common.injected_faults import Injected, problem
from atpid_sim.fields import Duration, Instant, Number, Range, SceneBlock, impossible, within


class Reading(SceneBlock):
    """What a channel reads of an exact signal."""

    noise: Annotated[Number, within(1e-15, 1e6, or_zero=True)] = Field(
        default=0.0, description="standard deviation of white noise [SI unit of the channel]"
    )
    saturation: Range | None = Field(
        default=None, description="lowest and highest value it can read [SI unit of the channel]; default: no limit"
    )

    @model_validator(mode="after")
    def _rising(self) -> Reading:
        if self.saturation is not None and self.saturation[1] <= self.saturation[0]:
            raise impossible("saturation", list(self.saturation), "two rising values")
        return self


class Sensor(Reading):
    """One device as the plant imitates it."""

    rate: Annotated[Number, within(1e-3, 1e7)] = Field(default=1000.0, description="samples a second [Hz]")


class Sensors(SceneBlock):
    """The sensors of the bench."""

    laser: Sensor = Field(default=Sensor(), description="support and beam displacement [m]")
    load_cell: Reading | None = Field(
        default=None,
        description="the driving force [N], in place of the support's displacement and at its rate; default: exact",
    )
    accelerometer: Sensor | None = Field(default=None, description="beam acceleration [m/s^2]; default: none")


class Recording(SceneBlock):
    """How the run is cut into messages and kept."""

    block: Duration = Field(default=0.05, description="length of one block of samples [s]")
    chunk: Annotated[int, Strict(), Field(ge=1024)] = Field(
        default=16384, description="size of a chunk in the bag [bytes]"
    )


# typing reads the names of a Literal only where they are written out
Part = Literal[
    "support_laser", "beam_laser", "accelerometer", "height_sensor", "motor", "serial_link", "recorder", "clock"
]
Kind = Literal["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"]


class Fault(SceneBlock):
    """One fault, from one time to another."""

    part: Part = Field(description="what fails")
    kind: Kind = Field(description="how it fails")
    begin: Instant = Field(alias="from", description="when it begins [s]")
    end: Instant = Field(alias="to", description="when it ends [s]")
    value: Annotated[Number, Field()] | None = Field(
        default=None, description="how much, in the unit of part and kind; default: as in docs/faults.md"
    )

    @model_validator(mode="after")
    def _can_be(self) -> Fault:
        value = math.nan if self.value is None else self.value
        if reason := problem(self.part, self.kind, self.begin, self.end, value):
            raise impossible("", f"{self.part} {self.kind} from {self.begin:g} to {self.end:g} s", reason)
        return self

    @property
    def injected(self) -> Injected:
        """The fault as nodes take it."""
        return Injected(self.part, self.kind, self.begin, self.end, math.nan if self.value is None else self.value)
