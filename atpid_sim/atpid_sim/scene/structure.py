# SPDX-License-Identifier: Apache-2.0
"""Beam and grain."""

from __future__ import annotations

from pydantic import Field

from atpid_sim.scene.fields import Block, Fraction, NotNegative, Positive


class Beam(Block):
    """The beam reduced to one mass, without the grain (equation 3.39)."""

    mass: Positive = Field(description="reduced mass of beam and container, without the grain [kg]")
    stiffness: Positive = Field(description="reduced stiffness [N/m]")
    damping: NotNegative = Field(description="reduced damping [N s/m]")


class Grain(Block):
    """The grain."""

    mass_fraction: Fraction = Field(description="grain mass over the mass of beam and grain together [-]")
    radius: Positive = Field(description="grain radius [m]")
