# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Elastic contact of a sphere with a flat wall, F = k x^1.5 (equations 3.9 and 3.17).

Parameters of the kernel: (stiffness k [N/m^1.5],).
"""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.spec import ELASTIC, ElasticSpec
from atpid_sim.system import System


class Spec(ElasticSpec):
    """Elastic contact (equation 3.9)."""

    example: ClassVar[Mapping[str, float]] = ELASTIC
    law: Literal["hertz"]

    def parameters(self, system: System) -> tuple[float, ...]:
        """Return the parameters of the kernel: (stiffness k [N/m^1.5],)."""
        return (self.stiffness_of(system),)


@kernel
def elastic_force(overlap, k):
    """k x^1.5 [N], continued oddly below zero so that a trial stage just outside the contact is harmless."""
    return k * overlap * math.sqrt(abs(overlap))


@kernel
def elastic_energy(overlap, k):
    """Energy stored at this overlap, 0.4 k x^2.5 [J]."""
    return 0.4 * k * overlap * overlap * math.sqrt(abs(overlap))


@kernel
def force(overlap, velocity, memory, p):
    """Contact force [N]."""
    return elastic_force(overlap, p[0])


@kernel
def detachment_velocity(overlap, memory, p):
    """Minus infinity while overlapped: the force vanishes only with the overlap."""
    return -math.inf if overlap >= 0.0 else math.inf


@kernel
def energy(overlap, memory, p):
    """Stored energy [J]."""
    return elastic_energy(overlap, p[0])


@kernel
def restitution(speed, mass, p):
    """One: nothing is lost."""
    return 1.0
