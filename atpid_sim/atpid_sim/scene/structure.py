# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Beam, grain and container, and how they begin where they are not at rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, TypeGuard

from pydantic import Field, model_validator

from atpid_sim.fields import Damping, Fraction, Length, Mass, Number, SceneBlock, Stiffness, Words, impossible, within

#: Largest damping ratio of the beam alone. Beyond, it follows the support and nothing else, but ever shorter steps are
#: needed and the ledger loses its digits: at 400 000 it is open by 1 %, and a second takes five.
_MOST_DAMPED = 2e4


class Beam(SceneBlock):
    """The beam reduced to one mass, without the grain (equation 3.39)."""

    mass: Mass = Field(description="reduced mass of beam and container, without the grain [kg]")
    stiffness: Stiffness = Field(description="reduced stiffness [N/m]; or give frequency")
    damping: Damping = Field(description="reduced damping [N s/m]; or give damping_ratio")

    alternatives: ClassVar[Mapping[str, str]] = {
        "frequency": "natural frequency without the grain [Hz], in place of stiffness",
        "damping_ratio": "damping over critical damping, without the grain [-], in place of damping",
    }

    @model_validator(mode="before")
    @classmethod
    def _in_newtons(cls, given: object) -> object:
        """Return the block with stiffness and damping in place of frequency and damping ratio.

        Where the mass is no number, which is reported, any stiffness will do.
        """
        if not isinstance(given, Mapping):
            return given
        own = dict(given)
        for key, alternative in (("stiffness", "frequency"), ("damping", "damping_ratio")):
            if key in own and alternative in own:
                raise impossible("", Words(f"{key} and {alternative}"), f"exactly one of {key}, {alternative}")
        mass = own.get("mass")
        if "frequency" in own:
            frequency = _number("frequency", own.pop("frequency"), 1e-6, 1e6)
            own["stiffness"] = (2.0 * math.pi * frequency) ** 2 * mass if _is_number(mass) else 1.0
        if "damping_ratio" in own:
            ratio = _number("damping_ratio", own.pop("damping_ratio"), 0.0, _MOST_DAMPED)
            stiffness = own.get("stiffness")
            product = mass * stiffness if _is_number(mass) and _is_number(stiffness) else 0.0
            own["damping"] = 2.0 * ratio * math.sqrt(max(product, 0.0))
        return own

    @model_validator(mode="after")
    def _oscillates(self) -> Beam:
        critical = 2.0 * math.sqrt(self.stiffness * self.mass)
        if self.damping > _MOST_DAMPED * critical * (1.0 + 1e-12):
            most = f"at most {_MOST_DAMPED:g} times critical, {_MOST_DAMPED * critical:g} N s/m"
            raise impossible("damping", self.damping, f"{most}: beyond, the beam only follows the support")
        return self


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(key: str, value: object, low: float, high: float) -> float:
    if not _is_number(value) or not low <= value <= high:
        raise impossible(key, value, f"from {low:g} to {high:g}")
    return float(value)


class FurtherMode(Beam):
    """A mode of the structure beside the one that `beam` is."""

    mass: Mass = Field(description="mass that an impulse at the container meets in this mode: modal over shape^2 [kg]")
    stiffness: Stiffness = Field(description="stiffness of the same normalisation [N/m]; or give frequency")
    damping: Damping = Field(description="damping of the same normalisation [N s/m]; or give damping_ratio")
    drive_factor: Annotated[Number, within(-1e3, 1e3)] = Field(
        default=0.0,
        description="share of the drive: of a moving support participation times shape at the container, beam has the "
        "rest of 1; of a force shape where it acts over shape at the container, over the same of beam [-]",
    )


class Grain(SceneBlock):
    """The grain."""

    mass_fraction: Fraction = Field(description="grain mass over the mass of beam and grain together [-]")
    radius: Length = Field(description="grain radius [m]")

    @model_validator(mode="before")
    @classmethod
    def _alone(cls, given: object) -> object:
        if isinstance(given, Mapping) and "count" in given:
            allowed = "one grain: grains that touch each other are left out"
            raise impossible("count", given["count"], allowed)
        return given


class Container(SceneBlock):
    """What the container does sideways: left out of every run, and named where it matters."""

    side_friction: Annotated[Number, within(0.0, 10.0)] | None = Field(
        default=None, description="friction coefficient of the grain on a side wall [-]; default: not checked"
    )
    slope: Annotated[Number, within(0.0, 1e6)] | None = Field(
        default=None,
        description="rotation over the beam's displacement, of a cantilever with its load at the tip 1.5 over the "
        "length [rad/m]; default: not checked",
    )


_Displacement = Annotated[Number, within(-1e3, 1e3)]  # [m]
_Velocity = Annotated[Number, within(-1e5, 1e5)]  # [m/s], upward
_Height = Annotated[Number, within(0.0, 1e6)]  # [m]


class Initial(SceneBlock):
    """State at time zero."""

    displacement: _Displacement = Field(default=0.0, description="of the beam from rest under the weight, upward [m]")
    velocity: _Velocity = Field(default=0.0, description="of the beam, upward [m/s]")
    grain_height: _Height = Field(default=0.0, description="of the grain above the floor; 0: it lies on it [m]")
    grain_velocity: _Velocity | None = Field(
        default=None, description="of the grain, upward; default: the beam's [m/s]"
    )

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
