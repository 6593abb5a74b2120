# SPDX-License-Identifier: Apache-2.0
"""How a run begins, where it is not at rest."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from atpid_sim.fields import Block, Number, impossible, within

Displacement = Annotated[Number, within(-1e3, 1e3)]  # [m]
Velocity = Annotated[Number, within(-1e5, 1e5)]  # [m/s], upward
Height = Annotated[Number, within(0.0, 1e6)]  # [m]


class Initial(Block):
    """State at time zero."""

    displacement: Displacement = Field(default=0.0, description="of the beam from rest under the weight, upward [m]")
    velocity: Velocity = Field(default=0.0, description="of the beam, upward [m/s]")
    grain_height: Height = Field(default=0.0, description="of the grain above the floor; 0: it lies on it [m]")
    grain_velocity: Velocity | None = Field(default=None, description="of the grain, upward; default: the beam's [m/s]")

    @property
    def grain_speed(self) -> float:
        """Velocity of the grain [m/s]."""
        return self.velocity if self.grain_velocity is None else self.grain_velocity

    @model_validator(mode="after")
    def _parts(self) -> Initial:
        if self.grain_height == 0.0 and self.grain_speed < self.velocity:
            allowed = f"at least velocity ({self.velocity:g} m/s) for a grain on the floor"
            raise impossible("grain_velocity", self.grain_velocity, allowed)
        return self
