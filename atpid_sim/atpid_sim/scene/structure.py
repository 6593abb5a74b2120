# SPDX-License-Identifier: Apache-2.0
"""Beam and grain."""

from __future__ import annotations

import math

from pydantic import Field, model_validator

from atpid_sim.scene.fields import Block, Damping, Fraction, Length, Mass, Stiffness, impossible

#: Largest damping ratio of the beam alone. Beyond, it follows the support and nothing else, but ever shorter steps are
#: needed and the ledger loses its digits: at 400 000 it is open by 1 %, and a second takes five.
_MOST_DAMPED = 2e4


class Beam(Block):
    """The beam reduced to one mass, without the grain (equation 3.39)."""

    mass: Mass = Field(description="reduced mass of beam and container, without the grain [kg]")
    stiffness: Stiffness = Field(description="reduced stiffness [N/m]")
    damping: Damping = Field(description="reduced damping [N s/m]")

    @model_validator(mode="after")
    def _swings_at_all(self) -> Beam:
        critical = 2.0 * math.sqrt(self.stiffness * self.mass)
        if self.damping > _MOST_DAMPED * critical:
            most = f"at most {_MOST_DAMPED:g} times critical, {_MOST_DAMPED * critical:g} N s/m"
            raise impossible("damping", self.damping, f"{most}: beyond, the beam only follows the support")
        return self


class Grain(Block):
    """The grain."""

    mass_fraction: Fraction = Field(description="grain mass over the mass of beam and grain together [-]")
    radius: Length = Field(description="grain radius [m]")
