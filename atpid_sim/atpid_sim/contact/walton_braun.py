# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hysteretic contact: linear loading and steeper linear unloading (Walton and Braun 1986).

F = min(k1 x, k2 (x - x0)), x0 = (1 - k1/k2) memory, memory the largest overlap of this contact so far. Parameters:
(k1 loading [N/m], k2 unloading [N/m]). What is lost is the area between the two lines, so the restitution is
sqrt(k1/k2) at every speed, and the grain detaches while still overlapped by x0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.spec import ContactSpec, require_one
from atpid_sim.fields import ContactStiffness, Number, Share, impossible
from atpid_sim.system import System

#: Least restitution: there the contact unloads 10^8 times steeper than it loads.
LEAST_RESTITUTION = 1e-4
#: The force depends on the deepest overlap of the contact.
HYSTERETIC = True


class Spec(ContactSpec):
    """Linear loading, steeper linear unloading: what lies between them is lost."""

    example: ClassVar[Mapping[str, float]] = {"stiffness": 1e5, "unloading_stiffness": 3e5}
    law: Literal["walton_braun"]
    stiffness: ContactStiffness = Field(description="stiffness in loading [N/m]")
    unloading_stiffness: Number | None = Field(default=None, description="in unloading [N/m]; or give restitution")
    restitution: Share | None = Field(
        default=None, description="root of loading over unloading stiffness, instead of the latter [-]"
    )

    @model_validator(mode="after")
    def _one_of(self) -> Spec:
        require_one(self, "unloading_stiffness", "restitution")
        unloading, restitution = self.unloading_stiffness, self.restitution
        if unloading is not None and unloading < self.stiffness:
            raise impossible("unloading_stiffness", unloading, f"at least stiffness ({self.stiffness:g} N/m)")
        if unloading is not None and unloading > self.stiffness / LEAST_RESTITUTION**2:
            steepest = (
                f"at most {LEAST_RESTITUTION**-2:g} times stiffness: the restitution is then {LEAST_RESTITUTION:g}"
            )
            raise impossible("unloading_stiffness", unloading, steepest)
        if restitution is not None and restitution < LEAST_RESTITUTION:
            least = f"from {LEAST_RESTITUTION:g} to 1: steps cannot follow a steeper unloading; law impact takes 0"
            raise impossible("restitution", restitution, least)
        return self

    def parameters(self, system: System) -> tuple[float, ...]:  # noqa: ARG002 one signature for all laws
        """(k1 loading [N/m], k2 unloading [N/m])."""
        unloading = self.unloading_stiffness or self.stiffness / (self.restitution or 1.0) ** 2
        return self.stiffness, unloading


@kernel
def _residual(overlap, memory, p):
    """Overlap at which the force vanishes in unloading [m]."""
    return (1.0 - p[0] / p[1]) * max(memory, overlap, 0.0)


@kernel
def force(overlap, velocity, memory, p):
    """Contact force [N], not clamped."""
    return min(p[0] * overlap, p[1] * (overlap - _residual(overlap, memory, p)))


@kernel
def detachment_velocity(overlap, memory, p):
    """Minus infinity above the overlap that remains, infinity below, at every velocity."""
    return -math.inf if overlap >= _residual(overlap, memory, p) else math.inf


@kernel
def residual_overlap(memory, p):
    """Overlap that remains when the force has vanished in unloading [m]: the dent."""
    return (1.0 - p[0] / p[1]) * max(memory, 0.0)


@kernel
def energy(overlap, memory, p):
    """Elastic energy [J]: what unloading returns."""
    depth = max(0.0, overlap - _residual(overlap, memory, p))
    return 0.5 * p[1] * depth * depth


@kernel
def restitution(speed, mass, p):
    """Restitution [-], the same at every speed [m/s]."""
    return math.sqrt(p[0] / p[1])
