# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the ceiling does: stand, open once, follow a profile, or obey a controller."""

from __future__ import annotations

import math
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field, Tag, model_validator
from pydantic_core import PydanticKnownError

from atpid_common.entry_points import SELECTORS
from atpid_sim.fields import (
    HeightPoints,
    HeightRange,
    Instant,
    Length,
    LocatedPath,
    SceneBlock,
    Speed,
    by_key,
    impossible,
    no_jump,
)

Heights = tuple[tuple[float, float], ...]


class _PrescribedCeiling(SceneBlock):
    """A ceiling that no controller moves; what a controlled one is asked for is unbounded, unknown or absent."""

    kind: ClassVar[str]
    controlled: ClassVar[bool] = False
    range: ClassVar[tuple[float, float]] = (0.0, math.inf)  # lowest and highest height [m]
    speed: ClassVar[float] = math.nan  # at which a controller may move it [m/s]
    controller: ClassVar[str] = ""  # how the height is selected
    map: ClassVar[Path | None] = None


class FixedCeiling(_PrescribedCeiling):
    """A fixed ceiling."""

    kind: ClassVar[str] = "fixed"
    height: Length = Field(description="height above the floor [m]")

    @property
    def heights(self) -> Heights:
        """((t [s], h [m]), ...)."""
        return ((0.0, self.height),)


class OpeningCeiling(_PrescribedCeiling):
    """A ceiling that goes once from closed to open, at constant speed (equations 3.35 and 3.36)."""

    kind: ClassVar[str] = "opening"
    closed: Length = Field(description="height before start [m]")
    open: Length = Field(description="height after end [m]")
    start: Instant = Field(description="when it begins to move [s]")
    end: Instant = Field(description="when it has arrived [s]")

    @model_validator(mode="after")
    def _in_order(self) -> OpeningCeiling:
        if self.end <= self.start:
            raise impossible("end", self.end, f"later than start ({self.start:g} s)")
        no_jump(self.heights, "end")
        return self

    @property
    def heights(self) -> Heights:
        """((t [s], h [m]), ...)."""
        return ((self.start, self.closed), (self.end, self.open))


class ProfileCeiling(_PrescribedCeiling):
    """A ceiling that follows given points, straight in between."""

    kind: ClassVar[str] = "profile"
    profile: HeightPoints = Field(description="[[t, h], ...] with straight ramps [s, m]")

    @property
    def heights(self) -> Heights:
        """((t [s], h [m]), ...)."""
        return self.profile


#: Methods that may move a ceiling; atpid_control/selection/registry.py has the code of each.
CONTROLLERS = ("lookup", "pca", "direct", "search")


def _installed(name: object) -> object:
    if name in CONTROLLERS:
        return name
    names = [*CONTROLLERS, *sorted(entry_points(group=SELECTORS).names)]
    if name in names:
        return name
    *first, last = map(repr, names)
    raise PydanticKnownError("literal_error", {"expected": f"{', '.join(first)} or {last}"})


Controller = Annotated[str, BeforeValidator(_installed)]


class ControlledCeiling(SceneBlock):
    """A ceiling that a controller moves at constant speed; it starts closed."""

    kind: ClassVar[str] = "controlled"
    controlled: ClassVar[bool] = True
    closed: Length = Field(description="height at the start [m]")
    range: HeightRange = Field(description="lowest and highest height the motor may reach [m]")
    speed: Speed = Field(description="the motor's constant speed [m/s]")
    controller: Controller = Field(description=f"how the height is selected: {', '.join(CONTROLLERS)}")
    map: LocatedPath | None = Field(default=None, description="height map for lookup, default: one made and kept")

    @model_validator(mode="after")
    def _within_range(self) -> ControlledCeiling:
        low, high = self.range
        if high <= low:
            raise impossible("range", list(self.range), "two rising heights")
        if not low <= self.closed <= high:
            raise impossible("closed", self.closed, f"a height within the range [{low:g}, {high:g}]")
        return self

    @property
    def heights(self) -> Heights:
        """((t [s], h [m]), ...) until a controller commands another height: closed."""
        return ((0.0, self.closed),)


Ceiling = Annotated[
    Annotated[FixedCeiling, Tag("<fixed>")]
    | Annotated[OpeningCeiling, Tag("<opening>")]
    | Annotated[ProfileCeiling, Tag("<profile>")]
    | Annotated[ControlledCeiling, Tag("<controlled>")],
    by_key(
        {
            "<controlled>": ("controller", "range", "speed"),
            "<profile>": ("profile",),
            "<fixed>": ("height",),
            "<opening>": ("closed", "open"),
        },
        "one of {height}, {closed, open, start, end}, {profile}, {closed, range, speed, controller}",
    ),
]
