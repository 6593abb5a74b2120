# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults that a run on the bench has on purpose."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from atpid_common.injected_faults import Injected, problem
from atpid_sim.fields import Instant, Number, SceneBlock, impossible

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
