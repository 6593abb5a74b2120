# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sensors and recording: only what a run on the bench needs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, Strict, model_validator

from atpid_sim.fields import Duration, Number, Range, SceneBlock, impossible, within


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
