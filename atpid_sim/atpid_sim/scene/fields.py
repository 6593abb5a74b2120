# SPDX-License-Identifier: Apache-2.0
"""What the blocks of a scene are made of: numbers, points, paths, and how a variant is told by its keys."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Strict, Tag
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import ValidationInfo


class Block(BaseModel):
    """One block of a scene: frozen, and without keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Fraction = Annotated[Number, Field(gt=0, lt=1)]
Share = Annotated[Number, Field(ge=0, le=1)]


class Words(str):
    """What was given, where that is not a value but has to be described."""

    def __repr__(self) -> str:
        return str(self)


def impossible(key: str, given: object, allowed: str) -> PydanticCustomError:
    """Return the error for a value that reads well and cannot be: key, what was given, what is allowed."""
    return PydanticCustomError("impossible", "{allowed}", {"key": key, "given": given, "allowed": allowed})


def _rising(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    for (left, _), (right, _) in pairwise(points):
        if right <= left:
            raise impossible("", right, f"times in rising order (the one before is {left:g})")
    return points


def _pair(value: Any) -> Any:
    if isinstance(value, list | tuple) and len(value) == 2:
        return tuple(value)
    raise impossible("", value, "a pair of numbers")


Point = Annotated[tuple[NotNegative, NotNegative], BeforeValidator(_pair)]
#: ((t, value), ...): straight between the points, constant before the first and after the last.
Points = Annotated[tuple[Point, ...], Field(min_length=1), AfterValidator(_rising)]
Range = Annotated[tuple[Number, Number], BeforeValidator(_pair)]


def _located(path: Path, info: ValidationInfo) -> Path:
    folder = (info.context or {}).get("folder")
    return path if path.is_absolute() or folder is None else (Path(folder) / path)


#: A path, taken from the folder of the scene file that names it.
LocatedPath = Annotated[Path, AfterValidator(_located)]


def _number_or_points(value: Any) -> str:
    return "<points>" if isinstance(value, list | tuple) else "<number>"


def _number_or_word(value: Any) -> str:
    return "<word>" if isinstance(value, str) else "<number>"


#: One number, or points.
NumberOrPoints = Annotated[
    Annotated[NotNegative, Tag("<number>")] | Annotated[Points, Tag("<points>")], Discriminator(_number_or_points)
]
#: Tells a word from a number before either is validated, so that the message speaks of the one that was meant.
by_word = Discriminator(_number_or_word)


def by_key(keys: Mapping[str, str], hint: str) -> Discriminator:
    """Return a discriminator that takes the variant whose telling key is present: {key: tag}."""

    def tag(value: Any) -> str | None:
        if isinstance(value, Mapping):
            return next((name for key, name in keys.items() if key in value), None)
        # a model that is validated again (copies): its kind says which one it is
        return f"<{value.kind}>" if hasattr(value, "kind") else None

    return Discriminator(tag, custom_error_type="no_variant", custom_error_message=hint)
