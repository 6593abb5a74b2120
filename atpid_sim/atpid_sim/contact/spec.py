# SPDX-License-Identifier: Apache-2.0
"""What the contact block of a scene has in common, whatever the law: its name, and parameters for the kernels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from atpid_sim.fields import Block, Modulus, Poisson, Words, impossible
from atpid_sim.system import System

#: A grain and walls of rubber: an example of the keys of `ElasticSpec`.
ELASTIC = {"young_modulus": 2.1e8, "poisson_ratio": 0.2}


class ContactSpec(Block):
    """The contact block of a scene; each law's file has its own, whose `law` is the name a scene gives."""

    #: Keys of a scene with values that are allowed, all but `law`; the tests of all laws take them.
    example: ClassVar[Mapping[str, float]]

    if TYPE_CHECKING:
        law: str

    def parameters(self, system: System) -> tuple[float, ...]:
        """Return the law's parameters for the kernels, at most six."""
        raise NotImplementedError


class ElasticSpec(ContactSpec):
    """What all laws after Hertz share: the elasticity of grain and walls (equation 3.14)."""

    young_modulus: Modulus = Field(description="Young's modulus of the grain [Pa]")
    poisson_ratio: Poisson = Field(description="Poisson's ratio of the grain [-]")
    wall_young_modulus: Modulus | None = Field(
        default=None, description="of floor and ceiling [Pa]; default: the grain's"
    )
    wall_poisson_ratio: Poisson | None = Field(
        default=None, description="of floor and ceiling [-]; default: the grain's"
    )

    def hertz_stiffness(self, radius: float) -> float:
        """Return k_c [N/m^1.5] of a sphere of `radius` [m] on a flat wall (equations 3.14 and 3.27)."""
        wall_modulus = self.wall_young_modulus or self.young_modulus
        wall_ratio = self.poisson_ratio if self.wall_poisson_ratio is None else self.wall_poisson_ratio
        compliance = (1.0 - wall_ratio**2) / wall_modulus + (1.0 - self.poisson_ratio**2) / self.young_modulus
        return 4.0 / 3.0 / compliance * math.sqrt(radius)


def require_one(block: Block, *keys: str) -> None:
    """Raise the error of a block that does not give exactly one of the keys."""
    given = [key for key in keys if getattr(block, key) is not None]
    if len(given) != 1:
        raise impossible("", Words(" and ".join(given) or "neither"), f"exactly one of {', '.join(keys)}")
