# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the contact block of a scene has in common, whatever the law: its name, and parameters for the kernels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field, model_validator

from atpid_common.errors import did_you_mean
from atpid_sim.contact.materials import MATERIALS, THESIS_MODULUS
from atpid_sim.fields import ContactStiffness, Modulus, Poisson, SceneBlock, Speed, Words, impossible
from atpid_sim.root import root
from atpid_sim.system import System, reduced_mass

#: The thesis's grain and walls: an example of the keys of `ElasticSpec`.
ELASTIC = {"young_modulus": THESIS_MODULUS, "poisson_ratio": 0.2}


class ContactSpec(SceneBlock):
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

    wall_stiffness: ContactStiffness | None = Field(
        default=None, description="of what gives way behind the contact, a spring in series [N/m]; default: rigid"
    )
    wall_speed: Speed | None = Field(
        default=None, description="closing speed at which the spring counts [m/s]; needed with wall_stiffness"
    )

    alternatives: ClassVar[Mapping[str, str]] = {
        "material": f"of the grain, in place of young_modulus and poisson_ratio: {', '.join(MATERIALS)}",
        "wall_material": "of floor and ceiling, in place of wall_young_modulus and wall_poisson_ratio: likewise",
    }

    @model_validator(mode="before")
    @classmethod
    def _of_materials(cls, given: object) -> object:
        """Return the block with the elasticity of the materials it names; what it gives itself stays."""
        if not isinstance(given, Mapping):
            return given
        own = dict(given)
        for key, wall in (("material", ""), ("wall_material", "wall_")):
            if key in own:
                name = own.pop(key)
                if name not in MATERIALS:
                    near = did_you_mean(str(name), MATERIALS)
                    raise impossible(key, name, f"{', '.join(MATERIALS)}, or numbers of your own{near}")
                own.setdefault(f"{wall}young_modulus", MATERIALS[name].young_modulus)
                own.setdefault(f"{wall}poisson_ratio", MATERIALS[name].poisson_ratio)
        return own

    @model_validator(mode="after")
    def _both_or_none(self) -> ElasticSpec:
        if (self.wall_stiffness is None) != (self.wall_speed is None):
            given = "wall_speed" if self.wall_stiffness is None else "wall_stiffness"
            raise impossible("", Words(f"{given} alone"), "wall_stiffness and wall_speed, or none of them")
        return self

    def stiffness_of(self, system: System) -> float:
        """Return k_c [N/m^1.5] of grain and wall, with what gives way behind the wall at its closing speed."""
        alone = self.hertz_stiffness(system.radius)
        if self.wall_stiffness is None or self.wall_speed is None:
            return alone
        return in_series(alone, self.wall_stiffness, reduced_mass(system), self.wall_speed)

    def hertz_stiffness(self, radius: float) -> float:
        """Return k_c [N/m^1.5] of a sphere of `radius` [m] on a flat wall (equations 3.14 and 3.27)."""
        wall_modulus = self.wall_young_modulus or self.young_modulus
        wall_ratio = self.poisson_ratio if self.wall_poisson_ratio is None else self.wall_poisson_ratio
        compliance = (1.0 - wall_ratio**2) / wall_modulus + (1.0 - self.poisson_ratio**2) / self.young_modulus
        return 4.0 / 3.0 / compliance * math.sqrt(radius)


def in_series(stiffness: float, spring: float, mass: float, speed: float) -> float:
    """Return k [N/m^1.5] of a Hertz contact with the largest force of one of `stiffness` and a spring [N/m] in series.

    Both take up m v^2/2 [kg, m/s]: 0.4 F^(5/3) k^(-2/3) + F^2/(2 K). At other speeds the force is between v and v^1.2.
    """
    energy = 0.5 * mass * speed**2
    softness = 0.4 * math.pow(stiffness, -2.0 / 3.0)

    def lacking(force: float) -> float:
        return (softness * math.pow(force, 5.0 / 3.0) + 0.5 * force**2 / spring) / energy - 1.0

    rigid = math.pow(energy / softness, 0.6)
    force = root(lacking, 0.0, rigid, xtol=1e-14 * rigid)
    return math.pow(0.4 * math.pow(force, 5.0 / 3.0) / energy, 1.5)


def require_one(block: SceneBlock, *keys: str) -> None:
    """Raise the error of a block that does not give exactly one of the keys."""
    given = [key for key in keys if getattr(block, key) is not None]
    if len(given) != 1:
        raise impossible("", Words(" and ".join(given) or "neither"), f"exactly one of {', '.join(keys)}")
