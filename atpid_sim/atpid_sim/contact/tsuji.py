# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hertz with damping by the fourth root of the overlap, F = k x^1.5 + c x' x^0.25 (Eqs 3.12, 3.24; Tsuji 1992).

Parameters: (k [N/m^1.5], c [N s/m^1.25]).
"""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from atpid_sim.contact import hertz
from atpid_sim.contact.hertz import elastic_force
from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.linear import damped_restitution
from atpid_sim.contact.spec import ELASTIC, ElasticSpec
from atpid_sim.fields import Number, within
from atpid_sim.system import System


class Spec(ElasticSpec):
    """Hertz with damping by the fourth root of the overlap (equations 3.12, 3.22-3.24): the thesis's own law."""

    example: ClassVar[Mapping[str, float]] = {"damping_ratio": 0.5, **ELASTIC}
    law: Literal["tsuji"]
    damping_ratio: Annotated[Number, within(1e-12, 1e6, or_zero=True)] = Field(
        description="damping ratio beta of equation 3.23 [-]"
    )

    def parameters(self, system: System) -> tuple[float, ...]:
        """Return the parameters of the kernel: (stiffness k [N/m^1.5], damping c [N s/m^1.25])."""
        k = self.stiffness_of(system)
        return k, 2.0 * self.damping_ratio * math.sqrt(k * system.grain_mass)


@kernel
def force(overlap, velocity, memory, p):
    """Contact force [N], not clamped."""
    return elastic_force(overlap, p[0]) + p[1] * velocity * math.sqrt(math.sqrt(abs(overlap)))


@kernel
def detachment_velocity(overlap, memory, p):
    """Overlap velocity at which the force vanishes [m/s]."""
    if p[1] > 0.0:
        return -p[0] / p[1] * overlap * math.sqrt(math.sqrt(abs(overlap)))
    return -math.inf if overlap >= 0.0 else math.inf


energy = hertz.energy


@kernel
def restitution(speed, mass, p):
    """Restitution [-], the same at every speed [m/s]; mass [kg] is the reduced one.

    In the variable x^1.25 the path (overlap, velocity) is that of a linear oscillator with damping ratio
    c / sqrt(5 k m), detachment included, so its closed form holds (after Antypov and Elliott, EPL 94 (2011) 50004,
    with F >= 0).
    """
    return damped_restitution(p[1] / math.sqrt(5.0 * p[0] * mass))
