# SPDX-License-Identifier: Apache-2.0
"""From a YAML file, or a mapping, to a scene; and from what is wrong with it to one useful line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from atpid_sim.scene import ceiling, contact, excitation
from atpid_sim.scene.errors import SceneError
from atpid_sim.scene.fields import Block
from atpid_sim.scene.model import Scene
from atpid_sim.scene.yaml12 import read_yaml

_VARIANTS: dict[str, type[Block]] = {**excitation.VARIANTS, **ceiling.VARIANTS, **contact.VARIANTS}


def load_scene(path: str | Path) -> Scene:
    """Read, check and return the scene in the YAML file `path`; raise SceneError in one line where it cannot be."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}; give the path of a scene file") from None
    except UnicodeDecodeError:
        raise SceneError(f"{path}: is not text; give a scene, a YAML file in UTF-8") from None
    return scene_from_mapping(read_yaml(text, str(path)), source=str(path), folder=file.parent)


def scene_from_mapping(mapping: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Check and return the scene in `mapping`; `source` names it in errors, relative paths start from `folder`."""
    if not isinstance(mapping, Mapping):
        wanted = ", ".join(Scene.model_fields)
        raise SceneError(f"{source}: given {_shown(mapping)}; allowed: a mapping with the keys {wanted}")
    try:
        return Scene.model_validate(dict(mapping), context={"folder": folder})
    except ValidationError as error:
        found = error.errors(include_url=False)
        rest = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        # a misspelt key also leaves a key missing: say the cause, not the consequence
        first = min(found, key=lambda item: item["type"] == "missing")
        raise SceneError(f"{source}: {_explain(first)}{rest}") from None


def _explain(error: ErrorDetails) -> str:
    kind, context = error["type"], error.get("ctx", {})
    key = _key(error["loc"])
    if kind == "extra_forbidden":
        return _unknown_key(error)
    if kind == "missing":
        return f"{key}: missing; allowed: {_meaning(error['loc'])}"
    if kind == "no_law":
        return _unknown_law(key, error)
    if kind == "no_variant":
        given = error["input"]
        shown = f"keys {', '.join(map(str, given))}" if isinstance(given, Mapping) and given else _shown(given)
        return f"{key}: given {shown}; allowed: {error['msg']}"
    if kind == "impossible":
        inner = context["key"]
        key = ".".join(part for part in (key, inner) if part)
        return f"{key}: given {_shown(context['given'])}; allowed: {context['allowed']}"
    if kind == "literal_error":
        return f"{key}: given {_shown(error['input'])}; allowed: {context['expected']}{_similar(error)}"
    allowed = error["msg"].removeprefix("Input should be ").removeprefix("a valid ")
    return f"{key}: given {_shown(error['input'])}; allowed: {allowed}"


def _unknown_key(error: ErrorDetails) -> str:
    name = str(error["loc"][-1])
    model = _model_at(error["loc"][:-1])
    keys = [field.alias or name for name, field in model.model_fields.items()] if model else []
    return f"{_key(error['loc'])}: unknown key{_did_you_mean(name, keys)}; allowed: {', '.join(keys)}"


def _unknown_law(key: str, error: ErrorDetails) -> str:
    given = error["input"]
    names = ", ".join(contact.LAW_NAMES)
    if not isinstance(given, Mapping):
        return f"{key}: given {_shown(given)}; allowed: a block with law, one of {names}"
    if "law" not in given:
        return f"{key}.law: missing; allowed: {names}"
    hint = _did_you_mean(str(given["law"]), contact.LAW_NAMES)
    return f"{key}.law: given {_shown(given['law'])}{hint}; allowed: {names}"


def _similar(error: ErrorDetails) -> str:
    names = [name.strip("'\" ") for name in error["ctx"]["expected"].replace(" or ", ",").split(",")]
    return _did_you_mean(str(error["input"]), names)


def _did_you_mean(given: str, names: Iterable[str]) -> str:
    close = difflib.get_close_matches(given, list(names), n=1, cutoff=0.5)
    return f"; did you mean {close[0]}?" if close else ""


def _key(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif not part.startswith("<"):
            text += f".{part}" if text else part
    return text


def _meaning(location: tuple[int | str, ...]) -> str:
    model = _model_at(location[:-1])
    for name, field in model.model_fields.items() if model else ():
        if location[-1] in (name, field.alias):
            return field.description or name
    return "a value"


def _model_at(location: tuple[int | str, ...]) -> type[Block] | None:
    """Return the block that the keys of `location` lead to."""
    model: type[Block] | None = Scene
    for part in location:
        if isinstance(part, str) and part in _VARIANTS:
            model = _VARIANTS[part]
        elif model is not None:
            fields = {field.alias or name: field for name, field in model.model_fields.items()}
            model = _block_in(fields[str(part)].annotation) if str(part) in fields else None if part else model
    return model


def _block_in(annotation: Any) -> type[Block] | None:
    choices = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    for choice in choices:
        if isinstance(choice, type) and issubclass(choice, Block):
            return choice
    return None


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
