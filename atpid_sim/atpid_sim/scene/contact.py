# SPDX-License-Identifier: Apache-2.0
"""The contact block of a scene: one variant per law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from atpid_sim.scene.fields import Block, ContactStiffness, Damping, Modulus, Number, Share, Words, impossible, within

#: Towards -1 a solid becomes infinitely stiff against a change of shape.
Poisson = Annotated[Number, within(-0.999, 0.5)]

#: Least restitution of the laws that can only come near a full stop: there the linear contact's damping is 500 000
#: times critical, and the hysteretic one unloads 10^8 times steeper than it loads.
LEAST_LINEAR, LEAST_WALTON_BRAUN = 1e-12, 1e-4


class ImpactContact(Block):
    """Hard contact: an instantaneous impact with constant restitution (equations 3.1-3.7)."""

    law: Literal["impact"]
    restitution: Share = Field(description="rebound speed over approach speed [-]")


class LinearContact(Block):
    """Linear viscoelastic contact (equation 3.8)."""

    law: Literal["linear"]
    stiffness: ContactStiffness = Field(description="contact stiffness [N/m]")
    damping: Damping | None = Field(default=None, description="contact damping [N s/m]; or give restitution")
    restitution: Share | None = Field(
        default=None, description="restitution between grain and container, instead of damping [-]"
    )

    @model_validator(mode="after")
    def _one_of(self) -> LinearContact:
        if (self.damping is None) == (self.restitution is None):
            raise impossible("", _given(self, "damping", "restitution"), "exactly one of damping, restitution")
        if self.restitution is not None and self.restitution < LEAST_LINEAR:
            allowed = f"from {LEAST_LINEAR:g} to 1: no finite damping stops the grain at once; law impact does with 0"
            raise impossible("restitution", self.restitution, allowed)
        return self


class ElasticContact(Block):
    """What all laws after Hertz share: the elasticity of grain and walls (equation 3.14)."""

    young_modulus: Modulus = Field(description="Young's modulus of the grain [Pa]")
    poisson_ratio: Poisson = Field(description="Poisson's ratio of the grain [-]")
    wall_young_modulus: Modulus | None = Field(
        default=None, description="of floor and ceiling [Pa]; default: the grain's"
    )
    wall_poisson_ratio: Poisson | None = Field(
        default=None, description="of floor and ceiling [-]; default: the grain's"
    )


class HertzContact(ElasticContact):
    """Elastic contact (equation 3.9)."""

    law: Literal["hertz"]


class LeeHerrmannContact(ElasticContact):
    """Hertz with linear damping (equation 3.10)."""

    law: Literal["lee_herrmann"]
    damping: Damping = Field(description="damping factor [N s/m]")


class KuwabaraKonoContact(ElasticContact):
    """Hertz with damping by the root of the overlap (equation 3.11)."""

    law: Literal["kuwabara_kono"]
    damping: Damping = Field(description="damping factor [N s/m^1.5]")


class TsujiContact(ElasticContact):
    """Hertz with damping by the fourth root of the overlap (equations 3.12, 3.22-3.24): the thesis's own law."""

    law: Literal["tsuji"]
    damping_ratio: Annotated[Number, within(1e-12, 1e6, or_zero=True)] = Field(
        description="damping ratio beta of equation 3.23 [-]"
    )


class WaltonBraunContact(Block):
    """Linear loading, steeper linear unloading: what lies between them is lost."""

    law: Literal["walton_braun"]
    stiffness: ContactStiffness = Field(description="stiffness in loading [N/m]")
    unloading_stiffness: Number | None = Field(default=None, description="in unloading [N/m]; or give restitution")
    restitution: Share | None = Field(
        default=None, description="root of loading over unloading stiffness, instead of the latter [-]"
    )

    @model_validator(mode="after")
    def _one_of(self) -> WaltonBraunContact:
        if (self.unloading_stiffness is None) == (self.restitution is None):
            given = _given(self, "unloading_stiffness", "restitution")
            raise impossible("", given, "exactly one of unloading_stiffness, restitution")
        if self.unloading_stiffness is not None and self.unloading_stiffness < self.stiffness:
            raise impossible(
                "unloading_stiffness", self.unloading_stiffness, f"at least stiffness ({self.stiffness:g} N/m)"
            )
        if self.unloading_stiffness is not None and self.unloading_stiffness > self.stiffness / LEAST_WALTON_BRAUN**2:
            steepest = (
                f"at most {LEAST_WALTON_BRAUN**-2:g} times stiffness: the restitution is then {LEAST_WALTON_BRAUN:g}"
            )
            raise impossible("unloading_stiffness", self.unloading_stiffness, steepest)
        if self.restitution is not None and self.restitution < LEAST_WALTON_BRAUN:
            allowed = f"from {LEAST_WALTON_BRAUN:g} to 1: steps cannot follow a steeper unloading; law impact takes 0"
            raise impossible("restitution", self.restitution, allowed)
        return self


def _given(block: Block, *keys: str) -> Words:
    present = [key for key in keys if getattr(block, key) is not None]
    return Words(" and ".join(present) or "neither")


def _law(value: Any) -> str | None:
    law = value.get("law") if isinstance(value, Mapping) else getattr(value, "law", None)
    return f"<{law}>" if isinstance(law, str) and f"<{law}>" in VARIANTS else None


VARIANTS: dict[str, type[Block]] = {
    "<impact>": ImpactContact,
    "<linear>": LinearContact,
    "<hertz>": HertzContact,
    "<lee_herrmann>": LeeHerrmannContact,
    "<kuwabara_kono>": KuwabaraKonoContact,
    "<tsuji>": TsujiContact,
    "<walton_braun>": WaltonBraunContact,
}
#: Names a scene may give as `contact.law`.
LAW_NAMES = tuple(tag.strip("<>") for tag in VARIANTS)

ContactSpec = Annotated[
    Annotated[ImpactContact, Tag("<impact>")]
    | Annotated[LinearContact, Tag("<linear>")]
    | Annotated[HertzContact, Tag("<hertz>")]
    | Annotated[LeeHerrmannContact, Tag("<lee_herrmann>")]
    | Annotated[KuwabaraKonoContact, Tag("<kuwabara_kono>")]
    | Annotated[TsujiContact, Tag("<tsuji>")]
    | Annotated[WaltonBraunContact, Tag("<walton_braun>")],
    Discriminator(_law, custom_error_type="no_law", custom_error_message=f"law: one of {', '.join(LAW_NAMES)}"),
]
