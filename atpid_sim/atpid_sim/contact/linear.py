# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Linear viscoelastic contact, F = k x + c x' (equation 3.8).

Parameters: (k [N/m], c [N s/m]).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.spec import ContactSpec, require_one
from atpid_sim.fields import ContactStiffness, Damping, Share, impossible
from atpid_sim.root import root
from atpid_sim.system import System, reduced_mass

#: Least restitution of a law that can only come near a full stop: the damping is 500 000 times critical there.
LEAST_RESTITUTION = 1e-12


class Spec(ContactSpec):
    """Linear viscoelastic contact (equation 3.8)."""

    example: ClassVar[Mapping[str, float]] = {"stiffness": 1e5, "damping": 20.0}
    law: Literal["linear"]
    stiffness: ContactStiffness = Field(description="contact stiffness [N/m]")
    damping: Damping | None = Field(default=None, description="contact damping [N s/m]; or give restitution")
    restitution: Share | None = Field(
        default=None, description="restitution between grain and container, instead of damping [-]"
    )

    @model_validator(mode="after")
    def _one_of(self) -> Spec:
        require_one(self, "damping", "restitution")
        if self.restitution is not None and self.restitution < LEAST_RESTITUTION:
            least = (
                f"from {LEAST_RESTITUTION:g} to 1: no finite damping stops the grain at once; law impact does with 0"
            )
            raise impossible("restitution", self.restitution, least)
        return self

    def parameters(self, system: System) -> tuple[float, ...]:
        """Return the parameters of the kernel: (stiffness k [N/m], damping c [N s/m])."""
        if self.damping is not None:
            return self.stiffness, self.damping
        ratio = damping_ratio_for(self.restitution or 0.0)
        return self.stiffness, 2.0 * ratio * math.sqrt(self.stiffness * reduced_mass(system))


def damping_ratio_for(restitution: float) -> float:
    """Return the damping ratio [-] of a linear contact with this restitution [-], from 1e-12 to 1.

    Raises ValueError for any other.
    """
    if not LEAST_RESTITUTION <= restitution <= 1.0:
        least = f"from {LEAST_RESTITUTION:g} to 1; law impact takes 0"
        raise ValueError(f"restitution: given {restitution:g}; allowed: {least}")
    if restitution == 1.0:
        return 0.0

    def excess(log_zeta: float) -> float:
        return math.log(damped_restitution(math.exp(log_zeta))) - math.log(restitution)

    # far beyond critical damping the restitution is 1 / (2 zeta)^2
    heaviest = max(5.5, 0.1 - 0.5 * math.log(4.0 * restitution))
    return math.exp(root(excess, -40.0, heaviest, xtol=1e-14))


@kernel
def force(overlap, velocity, memory, p):
    """Contact force [N], not clamped."""
    return p[0] * overlap + p[1] * velocity


@kernel
def detachment_velocity(overlap, memory, p):
    """Overlap velocity at which the force vanishes [m/s]."""
    if p[1] > 0.0:
        return -p[0] / p[1] * overlap
    return -math.inf if overlap >= 0.0 else math.inf


@kernel
def energy(overlap, memory, p):
    """Stored energy [J]."""
    return 0.5 * p[0] * overlap * overlap


@kernel
def damped_restitution(zeta):
    """Restitution of a damped oscillator that detaches where its force vanishes, zeta its damping ratio [-].

    The force vanishes after the angle 2 arccos(zeta), so e = exp(-2 zeta arccos(zeta) / sqrt(1 - zeta^2)); beyond
    critical damping arccosh takes its place (Schwager and Poeschel, Granular Matter 9 (2007) 465).
    """
    if zeta < 1.0 - 1e-9:
        return math.exp(-2.0 * zeta * math.acos(zeta) / math.sqrt(1.0 - zeta * zeta))
    if zeta > 1.0 + 1e-9:
        return math.exp(-2.0 * zeta * math.acosh(zeta) / math.sqrt(zeta * zeta - 1.0))
    return math.exp(-2.0)


@kernel
def restitution(speed, mass, p):
    """Restitution [-], the same at every speed [m/s]; mass [kg] is the reduced one."""
    return damped_restitution(0.5 * p[1] / math.sqrt(p[0] * mass))
