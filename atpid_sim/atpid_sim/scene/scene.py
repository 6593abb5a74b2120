# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scene: read from a YAML file or a mapping, checked, changed; the standard bench.

What is wrong with one is said in one line: key, what was given, what is allowed.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from atpid_common.errors import did_you_mean
from atpid_common.files import FileError, read_text
from atpid_sim.contact.laws import NAMES
from atpid_sim.fields import SceneBlock, variants_of
from atpid_sim.scene.ceiling import Ceiling
from atpid_sim.scene.excitation import Excitation
from atpid_sim.scene.model import ContactBlock, SceneValues
from atpid_sim.scene.plausibility import warnings_of
from atpid_sim.scene.yaml12 import SceneError, read_yaml

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


def decimal_comma(mapping: object, place: str = "") -> str:
    """Return the line for a number with a decimal comma in `{...}`, where YAML reads two entries; empty: none."""
    before, last = "", None
    for key, value in mapping.items() if isinstance(mapping, Mapping) else ():
        if isinstance(key, int) and value is None and before:
            given = f"{shown(last)} and, after a comma, {key}"
            return f"{place}{before}: given {given}; allowed: a number with a decimal point"
        before, last = str(key), value
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


def _block_in(annotation: object) -> type[SceneBlock] | None:
    choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType, tuple) else (annotation,)
    return next((choice for choice in choices if isinstance(choice, type) and issubclass(choice, SceneBlock)), None)


def shown(value: object) -> str:
    """Return a value as it was given, cut to a readable length."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


#: Size of a scene's file at most [bytes]: a profile of a whole day fits.
_LARGEST = 8_000_000
#: What a key of the beam is given in place of.
_REPLACES = {"frequency": "stiffness", "damping_ratio": "damping"}
#: Lines of a scene that are shown.
_SHOWN = 60
#: The standard bench of thesis section 3.4, which studies and figures start from.
_STANDARD: dict[str, object] = {
    "beam": {"mass": 0.3258, "stiffness": 427.6, "damping": 0.56},
    "grain": {"mass_fraction": 0.1, "radius": 0.0085},
    "contact": {"law": "tsuji", "young_modulus": 2.1e8, "poisson_ratio": 0.2, "damping_ratio": 1.0},
    "excitation": {"amplitude": 0.01, "frequency": "resonance"},
    "ceiling": {"height": 0.2},
    "gravity": 9.81,
    "duration": 16.0,
    "tolerance": 1e-6,
}


class Scene(SceneValues):
    """One run: structure, contact, excitation, ceiling and how long (docs/scenes.md)."""

    def warnings(self) -> list[str]:
        """Return one line for each value that is possible but unusual: key, value, usual range (`plausibility`)."""
        return warnings_of(self)

    def hint(self) -> str:
        """Return the unusual values as the end of an error's line; empty where there are none."""
        found = [line.partition(" is unusual")[0] for line in self.warnings()]
        return f"; unusual in the scene: {'; '.join(found)}" if found else ""

    def with_(self, *, height: float | None = None, mass_fraction: float | None = None, **changes: object) -> Scene:
        """Return a validated copy with some values changed.

        `height` [m] puts a fixed ceiling there; `mass_fraction`, and `amplitude` and `frequency` of a tone,
        replace that value in its block, as `beam={"mass": 0.4}` and `grain={...}` do with those given; any other name
        is a key of the scene itself (duration, ceiling={...}, ...).
        Under a closed ceiling the grain begins on the floor, wherever it did before.
        Raises SceneError as loading does.
        """
        mapping, changes = self.to_mapping(), {key: _plain(value) for key, value in changes.items()}
        if height is not None:
            mapping["ceiling"] = {"height": _plain(height)}
        if mass_fraction is not None:
            mapping["grain"]["mass_fraction"] = _plain(mass_fraction)
        for key in ("beam", "grain"):
            if isinstance(given := changes.get(key), Mapping):
                replaced = {_REPLACES[name] for name in given if name in _REPLACES}
                kept = {name: own for name, own in mapping[key].items() if name not in replaced}
                changes[key] = {**kept, **given}
        for key in ("amplitude", "frequency"):
            if key in changes:
                mapping["excitation"][key] = changes.pop(key)
        mapping |= changes
        start, ceiling = mapping.get("initial"), mapping["ceiling"]
        first = ceiling.get("height", ceiling.get("closed"))
        if start and first is not None and first <= 2.0 * self.grain.radius and "initial" not in changes:
            mapping["initial"] = {key: value for key, value in start.items() if not key.startswith("grain_")}
        return scene_from_mapping(mapping, source="changed scene")

    def __dir__(self) -> list[str]:
        """Return the names without pydantic's own."""
        return [name for name in super().__dir__() if name.startswith("__") or not hasattr(BaseModel, name)]

    def __repr__(self) -> str:
        lines = self.to_yaml().splitlines()
        return "\n".join(["Scene", *(f"  {line}" for line in lines[:_SHOWN]), *(["  ..."] if lines[_SHOWN:] else [])])

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return the text that a notebook shows."""
        return f"<pre>{html.escape(repr(self))}</pre>"


def _plain(value: object) -> object:
    """Return numpy's numbers and arrays as plain ones."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def load_scene(path: str | Path) -> Scene:
    """Read, check and return the scene in the YAML file `path`; raise SceneError in one line where that fails."""
    file = Path(path)
    try:
        text = read_text(file, _LARGEST)
    except FileError as error:
        raise SceneError(f"{error}; a scene is a YAML file in UTF-8") from None
    return scene_from_mapping(read_yaml(text, str(path)), source=str(path), folder=file.parent)


def scene_from_mapping(mapping: Mapping[str, object], source: str = "scene", folder: Path | None = None) -> Scene:
    """Check and return the scene in `mapping`; `source` names it in errors, relative paths start from `folder`."""
    if not isinstance(mapping, Mapping):
        wanted = ", ".join(Scene.model_fields)
        raise SceneError(f"{source}: given {shown(mapping)}; allowed: a mapping with the keys {wanted}")
    if comma := decimal_comma(mapping):
        raise SceneError(f"{source}: {comma}")
    try:
        return Scene.model_validate(dict(mapping), context={"folder": folder})
    except ValidationError as error:
        raise SceneError(f"{source}: {explained(error.errors(include_url=False))}") from None


def standard_bench(**changes: object) -> Scene:
    """Return the standard bench with the ceiling at 0.2 m, with some keys of the scene changed.

    Raises SceneError where a change does not fit.
    """
    return scene_from_mapping({**_STANDARD, **changes}, source="standard bench")
