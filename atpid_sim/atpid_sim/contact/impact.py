# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hard contact: an instantaneous exchange of momentum with constant restitution (equations 3.1-3.7).

Parameters: (restitution [-],). There is no force to integrate: only the fidelity `impact` takes this law. Its force is
NaN, which every run reports as a named outcome.
"""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from atpid_sim.contact.law_kernel import kernel
from atpid_sim.contact.spec import ContactSpec
from atpid_sim.fields import Share
from atpid_sim.system import System


class Spec(ContactSpec):
    """Hard contact: an instantaneous impact with constant restitution (equations 3.1-3.7)."""

    example: ClassVar[Mapping[str, float]] = {"restitution": 0.6}
    law: Literal["impact"]
    restitution: Share = Field(description="rebound speed over approach speed [-]")

    def parameters(self, system: System) -> tuple[float, ...]:  # noqa: ARG002 one signature for all laws
        """(restitution [-],)."""
        return (self.restitution,)


@kernel
def force(overlap, velocity, memory, p):
    """NaN: an instantaneous impact has no force."""
    return math.nan


@kernel
def detachment_velocity(overlap, memory, p):
    """Infinite: the grain detaches at once."""
    return math.inf


@kernel
def energy(overlap, memory, p):
    """Zero: nothing is stored."""
    return 0.0


@kernel
def restitution(speed, mass, p):
    """The parameter itself, at every speed."""
    return p[0]
