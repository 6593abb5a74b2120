# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the blocks of a scene are made of: numbers, points, paths, and how the keys select a variant."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Strict, Tag
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import ValidationInfo


class SceneBlock(BaseModel):
    """One block of a scene: frozen, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())
    #: Keys that may be given in place of others, and their meaning: converted before the block is validated.
    alternatives: ClassVar[Mapping[str, str]] = {}


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Share = Annotated[Number, Field(ge=0, le=1)]


class Words(str):
    """What was given, where that is not a value but has to be described."""

    def __repr__(self) -> str:
        return str(self)


def impossible(key: str, given: object, allowed: str) -> PydanticCustomError:
    """Return the error for a value that reads well and cannot be: key, what was given, what is allowed."""
    return PydanticCustomError("impossible", "{allowed}", {"key": key, "given": given, "allowed": allowed})


def within(low: float, high: float, or_zero: bool = False, hint: str = "") -> AfterValidator:
    """Return the check of a number: from `low` to `high`, with `or_zero` also 0; `hint` ends the message."""
    allowed = f"{'0, or ' if or_zero else ''}from {low:g} to {high:g}{hint and f' ({hint})'}"

    def check(value: float) -> float:
        if low <= value <= high or (or_zero and value == 0.0):
            return value
        raise impossible("", value, allowed)

    return AfterValidator(check)


# far wider than anything built, and so narrow that no quotient of two of them overflows
Mass = Annotated[Number, within(1e-6, 1e6)]  # [kg]
Stiffness = Annotated[Number, within(1e-6, 1e12)]  # [N/m]
ContactStiffness = Annotated[Number, within(1e-3, 1e15)]  # [N/m]
Modulus = Annotated[Number, within(1.0, 1e18)]  # [Pa]
#: Towards -1 a solid becomes infinitely stiff against a change of shape.
Poisson = Annotated[Number, within(-0.999, 0.5)]  # [-]
Damping = Annotated[Number, within(0.0, 1e9)]  # [N s/m], or as the law has it
Fraction = Annotated[Number, within(1e-6, 1.0 - 1e-6, hint="a share: 10 % is 0.1")]  # [-]
Length = Annotated[Number, within(1e-6, 1e6)]  # [m]
Amplitude = Annotated[Number, within(1e-12, 1e3, or_zero=True)]  # [m]
Hertz = Annotated[Number, within(1e-6, 1e6)]  # [Hz]
Duration = Annotated[Number, within(1e-6, 1e9)]  # [s]
Instant = Annotated[Number, within(1e-9, 1e9, or_zero=True)]  # [s]
Speed = Annotated[Number, within(1e-9, 1e6)]  # [m/s]
#: Straight ramps are no steeper than this [m/s]: a jump has no motion that a support or a motor could make.
_STEEPEST = 1e6
#: Points of an amplitude or a profile: each costs some 30 us to read.
_MOST_POINTS = 100_000


def _in_order(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    for (left, _), (right, _) in pairwise(points):
        if right <= left:
            raise impossible("", right, f"times in rising order (the one before is {left:g})")
    return points


def _rising(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    return no_jump(_in_order(points))


def no_jump(points: tuple[tuple[float, float], ...], key: str = "") -> tuple[tuple[float, float], ...]:
    """Return the points (t [s], value [m]); raise the error of `key` where a ramp between two is too steep."""
    for (begin, first), (end, last) in pairwise(points):
        if abs(last - first) > _STEEPEST * (end - begin):
            ramp = Words(f"{first:g} m to {last:g} m in {end - begin:g} s")
            raise impossible(key, ramp, f"at most {_STEEPEST:g} m/s: give the ramp more time")
    return points


def _pair(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) == 2:
        return tuple(value)
    raise impossible("", value, "a pair of numbers")


def _not_too_many(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) > _MOST_POINTS:
        raise impossible("", Words(f"{len(value)} points"), f"at most {_MOST_POINTS}")
    return value


_Value = TypeVar("_Value")
_Point = Annotated[tuple[Instant, _Value], BeforeValidator(_pair)]
#: ((t, value), ...): straight between the points, constant before the first and after the last.
_Points = Annotated[tuple[_Point[_Value], ...], BeforeValidator(_not_too_many), Field(min_length=1)]
_AmplitudePoints = Annotated[_Points[Amplitude], AfterValidator(_rising)]
FrequencyPoints = Annotated[_Points[Hertz], AfterValidator(_in_order)]
HeightPoints = Annotated[_Points[Length], AfterValidator(_rising)]
HeightRange = Annotated[tuple[Length, Length], BeforeValidator(_pair)]
Range = Annotated[tuple[Number, Number], BeforeValidator(_pair)]


def _located(path: Path, info: ValidationInfo) -> Path:
    folder = (info.context or {}).get("folder")
    return path if path.is_absolute() or folder is None else (Path(folder) / path)


#: A path, taken from the folder of the scene file that names it.
LocatedPath = Annotated[Path, AfterValidator(_located)]


#: One amplitude [m], or points.
AmplitudeOrPoints = Annotated[
    Annotated[Amplitude, Tag("<number>")] | Annotated[_AmplitudePoints, Tag("<points>")],
    Discriminator(lambda value: "<points>" if isinstance(value, list | tuple) else "<number>"),
]


def _type_given(value: object) -> str:
    if isinstance(value, list | tuple):
        return "<points>"
    return "<word>" if isinstance(value, str) else "<number>"


#: Selects the variant by the type that was given: the error is then about that variant only.
by_type = Discriminator(_type_given)


def by_key(keys: Mapping[str, Sequence[str]], hint: str) -> Discriminator:
    """Return a discriminator that selects the first variant of which a key is present: {tag: its keys}."""

    def tag(value: object) -> str | None:
        if isinstance(value, Mapping):
            return next((name for name, own in keys.items() if any(key in value for key in own)), None)
        # a model that is validated again (copies): `kind` names its variant
        return f"<{value.kind}>" if hasattr(value, "kind") else None

    return Discriminator(tag, custom_error_type="no_variant", custom_error_message=hint)


def variants_of(choice: object) -> dict[str, type[SceneBlock]]:
    """Return {tag: block} of the blocks from which a discriminator chooses."""
    union = get_args(choice)[0]
    return {tag.tag: block for block, tag in map(get_args, get_args(union))}
