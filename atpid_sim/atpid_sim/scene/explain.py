# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a scene in one line: key, what was given, what is allowed."""

import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic_core import ErrorDetails

from atpid_common.errors import did_you_mean
from atpid_sim.contact.laws import NAMES
from atpid_sim.fields import SceneBlock, variants_of
from atpid_sim.scene.ceiling import Ceiling
from atpid_sim.scene.excitation import Excitation
from atpid_sim.scene.model import ContactBlock, SceneValues

_CHOICES = {
    "excitation": variants_of(Excitation),
    "ceiling": variants_of(Ceiling),
    "contact": variants_of(ContactBlock),
}
_VARIANTS = {tag: block for choice in _CHOICES.values() for tag, block in choice.items()}

_WITH_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
#: A unit in a description.
_UNIT = re.compile(r"\[([^\]]+)\]")
#: Further keys that are named after the first error, at most.
_NAMED = 4


def explained(errors: Sequence[ErrorDetails], whole: type[SceneBlock] = SceneValues) -> str:
    """Return the first error in words, and the keys of the others; `whole`: the block that was validated."""
    # a default that depends on a wrong value is no error of its own
    errors = [error for error in errors if error["type"] != "default_factory_not_called"]
    # a misspelt key also leaves a key missing: the cause comes first, not the consequence
    first = min(errors, key=lambda item: item["type"] == "missing")
    others = list(dict.fromkeys(_key(error["loc"]) for error in errors if error is not first))
    more = ", ..." if len(others) > _NAMED else ""
    rest = f" (also wrong: {', '.join(others[:_NAMED])}{more})" if others else ""
    return f"{_explain(first, whole)}{rest}"


def _explain(error: ErrorDetails, whole: type[SceneBlock]) -> str:
    kind, context = error["type"], error.get("ctx", {})
    key = _key(error["loc"])
    if kind == "extra_forbidden":
        return _unknown_key(error, whole)
    if kind == "missing":
        return f"{key}: missing; allowed: {_meaning(error['loc'], whole)}"
    if kind == "no_law":
        return _unknown_law(key, error)
    if kind == "no_variant":
        given = error["input"]
        named = f"keys {', '.join(map(str, given))}" if isinstance(given, Mapping) and given else shown(given)
        return f"{key}: given {named}; allowed: {error['msg']}"
    if kind == "impossible":
        inner = context["key"]
        key = ".".join(part for part in (key, inner) if part)
        return f"{key}: given {shown(context['given'])}; allowed: {context['allowed']}"
    if kind == "model_type":
        keys = ", ".join(_keys(error["loc"], whole))
        return f"{key}: given {shown(error['input'])}; allowed: a block with the keys {keys}"
    if kind == "literal_error":
        similar = did_you_mean(str(error["input"]), re.findall(r"'([^']*)'", context["expected"]))
        word = "a bare number, or the word " if error["loc"][-1] == "<word>" else ""
        return f"{key}: given {shown(error['input'])}; allowed: {word}{context['expected']}{similar}"
    allowed = error["msg"].removeprefix("Input should be ").removeprefix("a valid ")
    if kind == "float_type" and isinstance(error["input"], str):
        allowed = _bare_number(error["input"], error["loc"], whole)
    return f"{key}: given {shown(error['input'])}; allowed: {allowed}"


def _bare_number(text: str, location: tuple[int | str, ...], whole: type[SceneBlock]) -> str:
    """Return what is allowed in place of a text that was meant as a number."""
    if _WITH_COMMA.fullmatch(text.strip()):
        return f"a number with a decimal point: {text.strip().replace(',', '.')}"
    named = tuple(part for part in location if isinstance(part, int) or not part.startswith("<number"))
    unit = _UNIT.search(_meaning(named, whole))
    return f"a bare number, in {unit[1]}" if unit and unit[1] != "-" else "a bare number"


def decimal_comma(mapping: Any, place: str = "") -> str:
    """Return the line for a number with a decimal comma in `{...}`, where YAML reads two entries; empty: none."""
    before = ""
    for key, value in mapping.items() if isinstance(mapping, Mapping) else ():
        if isinstance(key, int) and value is None and before:
            given = f"{shown(mapping[before])} and, after a comma, {key}"
            return f"{place}{before}: given {given}; allowed: a number with a decimal point"
        before = str(key)
        if inner := decimal_comma(value, f"{place}{key}."):
            return inner
    return ""


def _unknown_key(error: ErrorDetails, whole: type[SceneBlock]) -> str:
    name = str(error["loc"][-1])
    keys = _keys(error["loc"][:-1], whole)
    inner: dict[str, str] = {}
    for block in sorted(keys, key=lambda key: key.startswith("further_")) if len(error["loc"]) == 1 else ():
        for model in filter(None, [_model_at((block,), whole), *_CHOICES.get(block, {}).values()]):
            inner = {key: f"{block}.{key}" for key in model.model_fields if key not in keys} | inner
    similar = did_you_mean(name, keys, inner)
    return f"{_key(error['loc'])}: unknown key{similar}; allowed: {', '.join(keys)}"


def _unknown_law(key: str, error: ErrorDetails) -> str:
    given = error["input"]
    names = ", ".join(NAMES)
    if not isinstance(given, Mapping):
        return f"{key}: given {shown(given)}; allowed: a block with law, one of {names}"
    if "law" not in given:
        return f"{key}.law: missing; allowed: {names}"
    return f"{key}.law: given {shown(given['law'])}{did_you_mean(str(given['law']), NAMES)}; allowed: {names}"


def _key(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif not part.startswith("<"):
            text += f".{part}" if text else part
    return text


def _keys(location: tuple[int | str, ...], whole: type[SceneBlock]) -> list[str]:
    """Return the keys of the block that `location` leads to."""
    model = _model_at(location, whole)
    return [*(field.alias or name for name, field in model.model_fields.items()), *model.alternatives] if model else []


def _meaning(location: tuple[int | str, ...], whole: type[SceneBlock]) -> str:
    model = _model_at(location[:-1], whole)
    for name, field in model.model_fields.items() if model else ():
        if location[-1] in (name, field.alias):
            return field.description or name
    return "a value"


def _model_at(location: tuple[int | str, ...], whole: type[SceneBlock]) -> type[SceneBlock] | None:
    """Return the block that the keys of `location` lead to."""
    model: type[SceneBlock] | None = whole
    for part in location:
        if isinstance(part, int):  # one of a list of blocks
            continue
        if part in _VARIANTS:
            model = _VARIANTS[part]
        elif model is not None:
            fields = {field.alias or name: field for name, field in model.model_fields.items()}
            model = _block_in(fields[part].annotation) if part in fields else None if part else model
    return model


def _block_in(annotation: Any) -> type[SceneBlock] | None:
    choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType, tuple) else (annotation,)
    return next((choice for choice in choices if isinstance(choice, type) and issubclass(choice, SceneBlock)), None)


def shown(value: Any) -> str:
    """Return a value as it was given, cut to a readable length."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
