# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hertz with damping by the root of the overlap, F = k x^1.5 + c x' x^0.5 (equation 3.11; Kuwabara and Kono 1987).

Parameters: (k [N/m^1.5], c [N s/m^1.5]).
"""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from atpid_sim.contact import hertz, linear
from atpid_sim.contact.hertz import elastic_force
from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.rebound_series import KUWABARA_KONO, hertz_time, series_rebound
from atpid_sim.contact.spec import ELASTIC, ElasticSpec
from atpid_sim.fields import Damping
from atpid_sim.system import System


class Spec(ElasticSpec):
    """Hertz with damping by the root of the overlap (equation 3.11)."""

    example: ClassVar[Mapping[str, float]] = {"damping": 2e3, **ELASTIC}
    law: Literal["kuwabara_kono"]
    damping: Damping = Field(description="damping factor [N s/m^1.5]")

    def parameters(self, system: System) -> tuple[float, ...]:
        """Return the parameters of the kernel: (stiffness k [N/m^1.5], damping c [N s/m^1.5])."""
        return self.stiffness_of(system), self.damping


@kernel
def force(overlap, velocity, memory, p):
    """Contact force [N], not clamped."""
    return elastic_force(overlap, p[0]) + p[1] * velocity * math.sqrt(abs(overlap))


detachment_velocity = linear.detachment_velocity  # k x^1.5 + c x' x^0.5 and k x + c x' vanish at the same one
energy = hertz.energy


@kernel
def restitution(speed, mass, p):
    """Restitution [-] at an approach speed [m/s]; it falls with the speed; mass [kg] is the reduced one."""
    if speed <= 0.0:
        return 1.0
    time = hertz_time(speed, mass, p[0])
    return series_rebound(p[1] * time * math.sqrt(speed * time) / mass, 0.5, KUWABARA_KONO)
