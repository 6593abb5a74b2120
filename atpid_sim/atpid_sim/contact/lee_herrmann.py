# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hertz with linear damping, F = k x^1.5 + c x' (equation 3.10; Lee and Herrmann 1993).

Parameters: (k [N/m^1.5], c [N s/m]).
"""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from atpid_sim.contact import hertz
from atpid_sim.contact.hertz import elastic_force
from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.rebound_series import LEE_HERRMANN, hertz_time, series_rebound
from atpid_sim.contact.spec import ELASTIC, ElasticSpec
from atpid_sim.fields import Damping
from atpid_sim.system import System


class Spec(ElasticSpec):
    """Hertz with linear damping (equation 3.10)."""

    example: ClassVar[Mapping[str, float]] = {"damping": 5.0, **ELASTIC}
    law: Literal["lee_herrmann"]
    damping: Damping = Field(description="damping factor [N s/m]")

    def parameters(self, system: System) -> tuple[float, ...]:
        """Return the parameters of the kernel: (stiffness k [N/m^1.5], damping c [N s/m])."""
        return self.stiffness_of(system), self.damping


@kernel
def force(overlap, velocity, memory, p):
    """Contact force [N], not clamped."""
    return elastic_force(overlap, p[0]) + p[1] * velocity


@kernel
def detachment_velocity(overlap, memory, p):
    """Overlap velocity at which the force vanishes [m/s]."""
    if p[1] > 0.0:
        return -p[0] / p[1] * overlap * math.sqrt(abs(overlap))
    return -math.inf if overlap >= 0.0 else math.inf


energy = hertz.energy


@kernel
def restitution(speed, mass, p):
    """Restitution [-] at an approach speed [m/s]; it rises with the speed; mass [kg] is the reduced one."""
    if speed <= 0.0:
        return 1.0 if p[1] == 0.0 else 0.0
    return series_rebound(p[1] * hertz_time(speed, mass, p[0]) / mass, 0.0, LEE_HERRMANN)
